"""Components, models, effects: what files declare, and the laws that declarations must obey."""
