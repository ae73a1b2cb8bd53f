"""The lab: a page in the browser on which a mechanism runs, is changed, and is taken hold of.

Importing this package does not import viser; creating a `Page` does.

| module | contents |
|---|---|
| `lab` | `Lab`: session, page and file watch put together |
| `session`, `history` | the thread that owns the simulation, with its requests and frames; the last minutes of a run |
| `bench`, `hold` | a simulation whose numbers can all change; the spring of a hand, and configurations under the hand |
| `positions` | a mechanism that is moved through its positions by a joint |
| `preparing` | changes of live values are validated beside the session |
| `sliders`, `plots` | the numbers that can change, in the units of the file; curves of the motion |
| `scene` | the primitives of a mechanism in the scene of viser |
| `page` | the panel and its controls |
| `editing`, `keep` | the mechanism's file is saved; the motion as one HTML file |
| `safety` | who may open the page |
"""
