"""Peers in closed loop: the same scenarios, the same plant and one evaluator for all.

The modules, each of which uses only those before it:

* `scenario`: a scenario file as data.
* `motion`: exact motion under a held input, and the smallest distance over continuous time.
* `figures`: the figures of merit of a run, with the definitions of `clearway eval`.
* `law`: what a control law is to the loop, and the loop.
* `clearway`: our own runs, and the check that both evaluators agree on them.
* `roadmap`: ways around obstacles for peers that have none of their own.
* `certificates`: the rows of the paper's programme and of the corrected one.
* `orca`, `programme`: the peers.
* `catalogue`: which scenarios and which laws.
* `rows`, `report`: the results as JSON and as Markdown.
* `arguments`, `main`: the command.

All but `orca`, `programme` and what uses them need nothing but Python's standard library.
"""
