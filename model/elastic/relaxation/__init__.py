"""The elastic rule as agents: each moves its face until no load is left on it.

In comes a scene with an elastic rule; out goes a run with all steps, which holds an answer.
Read `push_table` (the shares), `push_state` (the loads left), `orders` (who acts when),
`elastic_model` (the Mesa model), then its two engines: `face_agent_engine` (objects) and
`face_array_engine` (arrays, compiled in `push_loops`). `push_stability` is the certificate;
`records` and `elastic_run` keep what happened.
"""
