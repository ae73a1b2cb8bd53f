"""The session of a lab: a mechanism that runs in a thread of its own, and everything that can be asked of it.

| module | contents |
|---|---|
| `session` | the thread that owns the simulation: its requests, frames and history |
| `bench`, `hold` | a simulation whose numbers can all change; the spring of a hand, and configurations under the hand |
| `positions` | a mechanism that is moved through its positions by a joint |
| `sliders` | the numbers that can change, in the units of the file |
| `background` | a saved file is read again, and new values are validated, while the session goes on |
"""
