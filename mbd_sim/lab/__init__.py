"""The lab: a page in the browser on which a mechanism runs, is changed, and is taken hold of.

Importing this package does not import viser; creating a `Page` does.

| module | contents |
|---|---|
| `lab` | `Lab`: session, page and file watch put together |
| `node_page` | the process of the page of a node |
| `session` | the mechanism that runs, and everything that can be asked of it; knows no page |
| `scene` | a mechanism in the scene of viser, on a page and in a file |
| `server` | the server of a page, and who may open it |
| `page` | the panel with its controls, and what keeps it up to date |
"""
