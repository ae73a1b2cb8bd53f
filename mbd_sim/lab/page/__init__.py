"""The page of a lab in the browser.

| module | contents |
|---|---|
| `page` | what the page contains, and the thread that shows the newest frame |
| `run_bar` | play, pause, step, reset, speed and the time line, with their keys |
| `change_tab` | sliders of everything that can change, and the lines for the file |
| `plots_tab` | curves of the motion |
| `kinematics_tab` | a turn of a drive: dead points, transmission angles, coupler curves |
| `reach_panel` | the target of a point, to which inverse kinematics brings the mechanism |
| `show_tab` | what the scene shows |
| `keep_tab` | recording, picture, animation, and the motion as one HTML file |
| `help_tab` | how to use the page, and what `mbd_sim check` says |
| `style`, `touched` | how the panel looks; which controls the user is moving |
"""
