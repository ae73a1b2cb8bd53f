"""The lab: a page in the browser on which a mechanism runs, is changed, and is taken hold of.

Importing this package does not import viser; creating a `Page` does.

| module | contents |
|---|---|
| `lab` | `Lab`: session, page and file watch put together |
| `session` | the mechanism that runs, and everything that can be asked of it; knows no page |
| `page` | what the browser shows, and its controls |
"""
