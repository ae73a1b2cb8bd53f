"""The lab: a page in the browser on which a mechanism runs, is changed, and is taken hold of.

Importing this package does not import viser; creating a `Page` does.

| module | contents |
|---|---|
| `lab` | `Lab`: session, page and file watch put together |
| `session` | the thread that owns the simulation: its requests, frames and history |
| `background` | a saved file is read again, and new values are validated, while the session goes on |
| `bench`, `hold` | a simulation whose numbers can all change; the spring of a hand, and configurations under the hand |
| `positions` | a mechanism that is moved through its positions by a joint |
| `sliders`, `plots` | the numbers that can change, in the units of the file; curves of the motion |
| `scene`, `page` | the scene of viser; the panel and its controls |
| `keep` | the motion as one HTML file |
| `safety` | who may open the page |
"""
