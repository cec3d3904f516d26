"""The public API: one object for a robot, one for a log, one for a result, methods named as the verbs are."""
