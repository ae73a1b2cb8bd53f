"""The topics of a run and their serialized messages, which nodes publish and recordings contain."""
