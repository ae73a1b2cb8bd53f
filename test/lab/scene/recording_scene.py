"""Stands for viser's scene: it keeps what was added, by name."""

from types import SimpleNamespace


class RecordingScene:
    """`nodes` are what was added last under each name; `added` counts the additions; `up` points upward."""

    def __init__(self):
        self.nodes, self.added, self.up = {}, 0, None

    def set_up_direction(self, direction):
        self.up = direction

    def __getattr__(self, method):
        if not method.startswith("add_"):
            raise AttributeError(method)

        def add(name, *arguments, **options):
            node = SimpleNamespace(**{"kind": method, "points": arguments[0] if arguments else (), **options})
            node.on_drag, node.remove = lambda _: lambda function: function, lambda: self.nodes.pop(name)
            self.nodes[name], self.added = node, self.added + 1
            return node

        return add
