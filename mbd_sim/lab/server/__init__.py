"""The server of a page.

| module | contents |
|---|---|
| `server` | a server of viser that is guarded and quiet |
| `safety` | who may open the page, and how much it may send |
"""
