"""Design of the experiment that distinguishes the alternatives of a diagnosis."""
