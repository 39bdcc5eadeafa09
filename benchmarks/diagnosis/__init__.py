"""How well a diagnosis names what is missing: false alarms, a confusion matrix over the catalogue, how large an effect must
be to be named, and effects hidden in a machine of real size. Each is run by a command of its own (`make false-alarms`, `make
confusion`, `make detectability`, `make compensator`), goes on where it was stopped, and writes its tables to
docs/diagnosis_study.md."""
