"""The session of a lab: a mechanism that runs in a thread of its own, and everything that can be asked of it.

| module | contents |
|---|---|
| `session`, `frames` | what pages ask of a run; what they show of it, and its history |
| `own_session` | the thread that owns a simulation: it serves requests and keeps time |
| `bench`, `hold` | a simulation whose numbers can all change; the spring of a hand, and configurations under the hand |
| `positions` | a mechanism that is moved through its positions by a joint |
| `reaching` | inverse kinematics of a point, in a thread of its own |
| `sliders` | the numbers that can change, in the units of the file |
| `continuation` | a run goes on in another simulation |
| `node_session`, `link` | the session on the run of a node, and its way to the node |
| `background` | a saved file is read again, and new values are validated, while the session goes on |
"""
