/* The memory of the history of delayed variables; see history.c. */
enum { NODES = model_n_d ? 8192 : 1, BREAKS = model_n_d ? 2048 : 1 }; /* of the history of delayed variables, in rings */
static const double PI = 3.14159265358979323846;

/* the sources of delayed variables: points, each in a stretch without discontinuities, and the discontinuities */
typedef struct {
  int number, stretches, breaks, next[model_n_d + 1]; /* next: the first discontinuity that has not returned */
  bool begun, set; /* set: an input, a parameter or a state was set since the last step */
  double begin, t[NODES], w[NODES][model_n_d + 1], largest[model_n_d + 1], at[BREAKS];
  int stretch[NODES], level[BREAKS];
} History;
