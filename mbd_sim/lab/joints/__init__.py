"""The joints of an imported assembly, chosen on a page.

| module | contents |
|---|---|
| `import_lab` | the choice, and then the lab of the mechanism that was built, on one server |
| `choice_page` | the panel: ground, a type for each joint, and what is built |
| `assembly_scene` | the parts, and the numbers of the joints |
"""
