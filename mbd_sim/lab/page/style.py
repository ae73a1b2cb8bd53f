"""How the page looks: a panel that is readable on a projector and as wide as the window on a phone, and notices."""

from __future__ import annotations

# viser sets these sizes of its sheet for phones in the elements themselves, by which they are found. Its notices lie
# over the scene and stay as long as the mouse is over them: they let the mouse through.
STYLE = """<style>
:root { --mantine-color-dimmed: #444c56 !important; font-size: %s; }
:root[data-mantine-color-scheme="dark"] { --mantine-color-dimmed: #b8c0ca !important; }
[role="tablist"] { flex-wrap: nowrap !important; overflow-x: auto; scrollbar-width: none; }
[role="tab"] { flex: 1 0 auto !important; padding-left: 0.1em !important; padding-right: 0.1em !important; }
[style*="max-height: 60%%"] { max-height: 45%% !important; width: 100%% !important; }
[style*="max-height: 60%%"] [style*="width: 20em"] { width: 100%% !important; }
.mantine-Notifications-notification { pointer-events: none !important; }
.mantine-Notifications-notification button { pointer-events: auto; }
</style>"""


def style(*, large: bool) -> str:
    """HTML with the style, for the panel."""
    return STYLE % ("125%" if large else "100%")
