"""Linear analysis: linearisation, modes, state space, margins, root locus, stability."""
