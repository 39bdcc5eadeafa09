/* The least that an integration by SUNDIALS costs: CVODE called from C, with compiled equations and their exact Jacobian.
   `rates` and `slopes` are functions that CasADi has written as C, of (t, x, p); NUMBER is the number of states and WORK the
   numbers that both need for themselves. */
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <string.h>
#include <sundials/sundials_config.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

int rates(const double **arg, double **res, int *iw, double *w, int mem);
int slopes(const double **arg, double **res, int *iw, double *w, int mem);

typedef int (*Equations)(const double **, double **, int *, double *, int);
static double work[WORK + 1];

static int evaluate(Equations equations, double t, N_Vector x, void *p, double *into)
{
  const double *arg[3] = {&t, N_VGetArrayPointer(x), p};
  double *res[1] = {into};
  return equations(arg, res, 0, work, 0);
}

static int right(sunrealtype t, N_Vector x, N_Vector dx, void *p)
{
  return evaluate(rates, t, x, p, N_VGetArrayPointer(dx));
}

static int jacobian(sunrealtype t, N_Vector x, N_Vector dx, SUNMatrix j, void *p, N_Vector a, N_Vector b, N_Vector c)
{
  return evaluate(slopes, t, x, p, SUNDenseMatrix_Data(j));
}

/* x at n evenly spaced times up to the end, one after the other; the number of steps, or less than 0 */
long integrate(const double *start, double *p, double end, int n, double rtol, double atol, double *found)
{
  SUNContext context;
  double t = 0;
  long steps = -1;
#if SUNDIALS_VERSION_MAJOR >= 7
  if (SUNContext_Create(SUN_COMM_NULL, &context)) return -1;
#else
  if (SUNContext_Create(NULL, &context)) return -1;
#endif
  N_Vector x = N_VNew_Serial(NUMBER, context);
  memcpy(N_VGetArrayPointer(x), start, NUMBER * sizeof(double));
  SUNMatrix matrix = SUNDenseMatrix(NUMBER, NUMBER, context);
  SUNLinearSolver solver = SUNLinSol_Dense(x, matrix, context);
  void *memory = CVodeCreate(CV_BDF, context);
  int failed = CVodeInit(memory, right, 0, x) || CVodeSStolerances(memory, rtol, atol) || CVodeSetUserData(memory, p) ||
               CVodeSetMaxNumSteps(memory, 1000000) || CVodeSetLinearSolver(memory, solver, matrix) ||
               CVodeSetJacFn(memory, jacobian);
  for (int k = 0; k < n && !failed; k++) {
    failed = CVode(memory, end * (k + 1) / n, x, &t, CV_NORMAL) < 0;
    memcpy(found + k * NUMBER, N_VGetArrayPointer(x), NUMBER * sizeof(double));
  }
  if (!failed) CVodeGetNumSteps(memory, &steps);
  CVodeFree(&memory);
  SUNLinSolFree(solver);
  SUNMatDestroy(matrix);
  N_VDestroy(x);
  SUNContext_Free(&context);
  return steps;
}
