/* A run of the equations in model.c: its values, their evaluation, the start, events and steps. An FMU and a C program with
   events share it. */
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include "rosenbrock.c"
#include "history_memory.c"
#include "values.c"
#include "history.c"
#include "fmu_events.c"
#include "variable_step.c"
