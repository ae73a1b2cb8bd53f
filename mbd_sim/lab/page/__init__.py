"""The page of a lab in the browser: its scene, its panel, and who may open it.

| module | contents |
|---|---|
| `page` | the server, what its page contains, and the thread that shows the newest frame |
| `scene`, `camera`, `style` | the scene of viser, from where it is seen, and how the panel looks |
| `run_bar` | play, pause, step, reset, speed and the time line, with their keys |
| `change_tab` | sliders of everything that can change, and the lines for the file |
| `plots_tab` | curves of the motion |
| `show_tab` | what the scene shows |
| `keep_tab`, `keep` | recording, picture, and the motion as one HTML file |
| `help_tab` | how to use the page, and what `mbd_sim check` says |
| `touched` | which controls the user is moving |
| `safety` | who may open the page |
"""
