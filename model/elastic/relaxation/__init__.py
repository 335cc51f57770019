"""The elastic rule as agents: each moves its face until no load is left on it.

In comes a scene with an elastic rule; out goes a run with all steps, which holds an answer.
Read `push_table` (the shares, and a certificate of waves), `push_state` (the loads left, and who
acts when), `elastic_model` (the Mesa model, and its engine of objects), then `face_array_engine`
(arrays, compiled). `elastic_run` keeps what happened.
"""
