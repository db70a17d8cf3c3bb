/*
 * @title@
 *
 * Mean and covariance of the states of a random vibration model (CADET), as C99. Written by cadet-sym @version@
 * (CasADi @casadi@); do not edit, export again.
 *
 * The moments y are packed: means of the states, then the lower triangle of their covariance column by column
 * (use @p@_covariance), then what is integrated alongside. No function allocates memory or keeps any state; results
 * must not overlap arguments. Compile with -D@P@_FLOAT for single precision.
 */
#ifndef @P@_H
#define @P@_H

#ifdef __cplusplus
extern "C" {
#define @P@_RESTRICT
#else
#define @P@_RESTRICT restrict
#endif

#ifdef @P@_FLOAT
typedef float @p@_real;
#else
typedef double @p@_real;
#endif

enum {
    @P@_STATES = @states@,
    @P@_PARAMETERS = @parameters@,
    @P@_OUTPUTS = @outputs@,
    @P@_MOMENTS = @moments@, /* means and covariances */
    @P@_SIZE = @size@, /* of y: the moments@alongside@ */
    @P@_NONZEROS = @nonzeros@, /* of the Jacobian */
    @P@_SWITCHES = @switches@ /* functions of t and s whose sign changes at a breakpoint */
};

/* Operations of one evaluation@dependence@.
@operations@
 */
enum {
    @P@_RATE_OPERATIONS = @rate_operations@,
    @P@_OUTPUT_OPERATIONS = @output_operations@
};

@state_enum@
@parameter_enum@
@output_enum@
extern const char *const @p@_model;
extern const char *const @p@_state_names[];
extern const char *const @p@_parameter_names[];
extern const char *const @p@_output_names[];
extern const @p@_real @p@_default_parameters[];
extern const @p@_real @p@_duration;   /* of the model's own run */
extern const int @p@_points;          /* output times of that run, both ends */
extern const @p@_real @p@_start_speed; /* V(0) at the default parameters */

/* Index into y of the covariance of two states. */
int @p@_covariance(int i, int j);

/* dy/dt. */
void @p@_rate(@p@_real t, const @p@_real *@P@_RESTRICT y, const @p@_real *@P@_RESTRICT p, @p@_real *@P@_RESTRICT dy);

/* d(dy/dt)/dy: the @P@_NONZEROS values, column by column; entry k stands in row @p@_jacobian_row[k], and column j
 * holds the entries from @p@_jacobian_column[j] up to, without, @p@_jacobian_column[j + 1]. */
void @p@_jacobian(@p@_real t, const @p@_real *@P@_RESTRICT y, const @p@_real *@P@_RESTRICT p,
                  @p@_real *@P@_RESTRICT values);
extern const int @p@_jacobian_column[];
extern const int @p@_jacobian_row[];

/* The same as a full matrix, @P@_SIZE by @P@_SIZE, column by column. */
void @p@_jacobian_dense(@p@_real t, const @p@_real *@P@_RESTRICT y, const @p@_real *@P@_RESTRICT p,
                        @p@_real *@P@_RESTRICT matrix);

/* d(dy/dt)/dt. */
void @p@_slope(@p@_real t, const @p@_real *@P@_RESTRICT y, const @p@_real *@P@_RESTRICT p,
               @p@_real *@P@_RESTRICT slope);

/* Means and variances of the outputs. */
void @p@_outputs(@p@_real t, const @p@_real *@P@_RESTRICT y, const @p@_real *@P@_RESTRICT p,
                 @p@_real *@P@_RESTRICT mean, @p@_real *@P@_RESTRICT variance);

/* Speed, its rate, the distance (0 where it is integrated in y), the distance at the start. */
void @p@_motion(@p@_real t, const @p@_real *@P@_RESTRICT p, @p@_real *@P@_RESTRICT motion);

/* y at t = 0@initial_note@. */
void @p@_initial(const @p@_real *@P@_RESTRICT p, @p@_real *@P@_RESTRICT y);

/* Breakpoints of a run: times at which an input changes abruptly and the integration must start anew, increasing.
 * Writes at most `room` of them and returns how many there are. */
int @p@_breakpoints(const @p@_real *p, @p@_real duration, @p@_real *times, int room);

/* ---- How a call ended ------------------------------------------------------------------------------------ */

typedef enum {
    @P@_OK = 0,
    @P@_TOO_MANY_STEPS, /* the explicit method on a stiff problem, or a tolerance that is too tight */
    @P@_STEP_TOO_SMALL, /* the moments grow without bound, or the tolerance is below rounding */
    @P@_NOT_FINITE,     /* a rate is not a number: check the parameters and the start */
    @P@_SINGULAR,       /* a linear system has no solution: states, or a combination of them, drift without bound */
    @P@_NO_CONVERGENCE, /* no stationary moments were found from this start */
    @P@_NOT_SEMIDEFINITE /* what was found is not a covariance */
} @p@_status;

const char *@p@_status_text(@p@_status status);

/* ---- Propagation ----------------------------------------------------------------------------------------- */

/* A linear system with the Jacobian, decomposed. */
typedef struct {
@factors@
} @p@_factors;

/* Working memory of the stiff method; of no interest otherwise. */
typedef struct {
    @p@_real values[@P@_NONZEROS > 0 ? @P@_NONZEROS : 1];
    @p@_real stages[6][@P@_SIZE];
    @p@_real slope[@P@_SIZE];
    @p@_real diagonal[@P@_SIZE];
    @p@_factors factors;
} @p@_stiff;

/* A run in progress. Set up with @p@_begin; the fields up to the blank line may then be changed. */
typedef struct {
    @p@_real rtol;         /* relative error of a step (default 1e-6) */
    @p@_real floor;        /* what counts as zero, over a moment's own size (default 1e-4) */
    @p@_real longest_step; /* default: no bound */
    long most_steps;       /* of one call (default 1000000) */
    @p@_stiff *stiff;      /* 0: explicit (Dormand & Prince 5(4)); else Rosenbrock (Rodas 4(3)), with this memory */
    const @p@_real *breakpoints; /* increasing; 0: none */
    int breakpoint_count;

    @p@_real t;
    @p@_real y[@P@_SIZE];
    @p@_real step; /* to be tried next */
    long steps, refused, rates;
    @p@_real size[@P@_SIZE];
    @p@_real stages[7][@P@_SIZE];
    @p@_real trial[@P@_SIZE];
    int settled; /* moments of the ground's filters that stay as they are */
    int fresh; /* stages[0] holds the rate at (t, y) */
} @p@_run;

void @p@_begin(@p@_run *run, @p@_real t, const @p@_real *y);

/* Integrate to a later time. On failure `run` holds what was reached. */
@p@_status @p@_propagate(@p@_run *run, const @p@_real *p, @p@_real until);

/* Fixed steps for real time: one step of the classical Runge-Kutta method, 4 rates. `work` has room for
 * 5 * @P@_SIZE values. The cost is the same for all data: @P@_STEP_OPERATIONS operations. */
void @p@_fixed_step(@p@_real t, @p@_real step, @p@_real *y, const @p@_real *p, @p@_real *work);
enum { @P@_STEP_OPERATIONS = 4 * @P@_RATE_OPERATIONS + 13 * @P@_SIZE + 4 };

/* ---- Stationary moments ---------------------------------------------------------------------------------- */

typedef struct {
    @p@_real values[@P@_NONZEROS > 0 ? @P@_NONZEROS : 1];
    @p@_real second[@squares@];
    @p@_real third[@squares@];
    @p@_real vectors[11][@P@_SIZE];
    @p@_factors factors;
    int left_out[@P@_SIZE];
} @p@_stationary_work;

typedef struct {
    @p@_real speed;    /* held constant; of no meaning without ground */
    @p@_real t, s;     /* instant and place at which explicit dependence is frozen (default 0) */
    int most_steps;    /* of each method (default 200) */
    @p@_real residual; /* of the moment equations over the size of their own terms */
    int steps;
    int stable;        /* as a fixed point of the moment equations */
    int drifting[@P@_STATES]; /* 1: the state has no stationary moments, and nothing depends on it; its moments are NaN */
    @p@_stationary_work *work;
} @p@_stationary_problem;

void @p@_stationary_begin(@p@_stationary_problem *problem, @p@_real speed, @p@_stationary_work *work);

/* 1: rates depend on t or s, so that nothing is stationary but with both frozen. */
enum { @P@_EXPLICIT = @explicit@ };

/* Stationary moments near y (Newton, then pseudo-transient continuation); with all of y zero, from next to none. */
@p@_status @p@_stationary(@p@_stationary_problem *problem, const @p@_real *p, @p@_real *y);

/* y at t = 0, stationary where the model starts so (`work` is needed then only; 0 else). */
enum { @P@_STEADY_START = @steady@ };
@p@_status @p@_start(const @p@_real *p, @p@_stationary_work *work, @p@_real *y);

/* The rate, its Jacobian (pattern as above) and the outputs at a speed held constant. */
void @p@_held_rate(@p@_real t, @p@_real s, @p@_real V, const @p@_real *@P@_RESTRICT y,
                   const @p@_real *@P@_RESTRICT p, @p@_real *@P@_RESTRICT dy);
void @p@_held_jacobian(@p@_real t, @p@_real s, @p@_real V, const @p@_real *@P@_RESTRICT y,
                       const @p@_real *@P@_RESTRICT p, @p@_real *@P@_RESTRICT values);
void @p@_held_outputs(@p@_real t, @p@_real s, @p@_real V, const @p@_real *@P@_RESTRICT y,
                      const @p@_real *@P@_RESTRICT p, @p@_real *@P@_RESTRICT mean,
                      @p@_real *@P@_RESTRICT variance);

/* ---- Parts of the above ---------------------------------------------------------------------------------- */

/* Functions of t and s whose sign changes at a breakpoint. */
void @p@_switches(@p@_real t, @p@_real s, const @p@_real *@P@_RESTRICT p, @p@_real *@P@_RESTRICT values);
/* 1 if the distance is integrated in y, at index @P@_MOMENTS; else it is known in closed form. */
enum { @P@_DISTANCE = @distance@ };

/* LU decomposition with pivoting, in place, of a full matrix (column by column); 0 if it is singular. */
int @p@_decompose(int n, @p@_real *matrix, int *pivots);
void @p@_solve(int n, const @p@_real *matrix, const int *pivots, @p@_real *x);
/* factor * Jacobian + a diagonal matrix, decomposed; 0 if it is singular. x becomes the solution for x. */
int @p@_factorise(const @p@_real *values, @p@_real factor, const @p@_real *diagonal, @p@_factors *factors);
void @p@_backsolve(const @p@_factors *factors, @p@_real *x);
/* Add factor * Jacobian to a full matrix. */
void @p@_add_jacobian(const @p@_real *values, @p@_real factor, @p@_real *matrix);

#ifdef __cplusplus
}
#endif
#endif
