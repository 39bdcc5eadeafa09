"""How well a diagnosis names what is missing: false alarms, a confusion matrix over the catalogue, and how large an effect
must be to be named. Each is run by a command of its own (`make false-alarms`, `make confusion`, `make detectability`), goes
on where it was stopped, and writes its tables to docs/diagnosis_study.md."""
