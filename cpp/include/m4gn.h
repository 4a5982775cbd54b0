/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * C ABI of libm4gn.so: everything a solver needs to be a host of M4GN.
 *
 * Only sized arrays of double, int32_t and int64_t cross this boundary. Vectors are always three doubles
 * (x, y, z), row after row, whatever the number of solved directions. Lengths in metres, times in seconds.
 * Pointers passed in are read during the call, unless they are said to be kept. One thread at a time uses an object. A function of
 * the host that is called back throws nothing and makes no call with the object that calls it.
 *
 * Status: 0 fine; > 0 the call failed and the object is as it was (bad input, file); < 0 the object must only
 * be freed. m4gn_last_error() then says what was expected, what was found, where, and what to do.
 * What is called m4gn_OBJECT_n_... gives a count, or -1 after an error.
 * Calls marked "collective" are made by every rank of the communicator; they return the same class of
 * status on all ranks, so that no rank waits for another that has left. All settings must be the same on all ranks,
 * the file's name of a path included, but not what belongs to a rank alone: its arrays, threads and device. A rank that
 * breaks (a defect of this library) makes the call fail with M4GN_ERROR_INTERNAL on all; where another one waits inside
 * a library and cannot be told, the job is ended after 10 s with a message. Only what names the communicator cannot be
 * agreed upon: comm, and the handle of an object, must be valid on every rank.
 *
 * Every call saves, clears and restores the floating-point traps, so that a host that traps (OpenFOAM's
 * FOAM_SIGFPE) is neither disturbed nor disturbs. MPI and PETSc are joined if they are up.
 */
#ifndef M4GN_H
#define M4GN_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define M4GN_ABI_VERSION 19

/* Pass instead of MPI_Comm_c2f(comm) where the host runs without MPI. */
#define M4GN_NO_MPI INT32_MIN

enum
{
    M4GN_OK = 0,
    M4GN_ERROR_INPUT = 1,
    M4GN_ERROR_FILE = 2,
    M4GN_ERROR_MODEL = 3,
    M4GN_ERROR_MESH = 4,
    M4GN_ERROR_NUMERICAL = 5,
    M4GN_ERROR_INTERRUPTED = 6,
    M4GN_ERROR_OTHER_RANK = 7,
    M4GN_ERROR_INTERNAL = -1
};

/* Node types of the graph (paper, table 2); M4GN_FLUID is every cell, of a solid too. */
enum
{
    M4GN_FLUID = 0,
    M4GN_WALL = 1,
    M4GN_INLET = 2,
    M4GN_OUTLET = 3,
    M4GN_SYMMETRY = 4,
    M4GN_OBSTACLE = 5,
    M4GN_BODY = 6,   /* a point of a body */
    M4GN_HANDLE = 7, /* of a body: the displacement is prescribed */
    M4GN_FREE = 8    /* of a body: a free or loaded surface */
};

/* Version of this interface that the library was built with; compare with M4GN_ABI_VERSION. */
int32_t m4gn_abi_version(void);

/* Version of the library, "0.1.0". */
const char* m4gn_version(void);

/* Message of the last failed call on this thread; empty when there was none. Valid until the next call. */
const char* m4gn_last_error(void);

/* Collective. Ends MPI and PETSc if this library started them, which is done at the end of the process anyway: for hosts
 * without MPI that must see it ended earlier. Nothing that needs them can be done afterwards. */
void m4gn_finalize(void);

/* ---- settings ----------------------------------------------------------------------------------- */

/* What is words and numbers is given to a call as its settings: the text of a JSON object, or NULL for {}. What is not given
 * has its default. The names are those of a case dictionary (docs/reference/dictionary.md), as distance_scale or as distanceScale. A
 * name that is not known and a value of another type or out of range are M4GN_ERROR_INPUT, with a message that names the
 * entry, what was expected and what was found. The tables are made of the settings structs of the core (tests/tables.rs).
 *
 * segments: how the mesh is cut, an object of what differs from the model's segmentation (m4gn_session_new; m4gn_segments_new
 * with a model), or from the defaults:
 *
 * [table segments]
 *   name            default    meaning
 *   method          "slic-md"  metis, METIS alone; slic-md, METIS refined by SLIC on modes and positions; slic-mdodl or
 *                              slic-mdode, with the logarithm or the exponential of the distance to the obstacle as well (eq.
 *                              14)
 *   count           36         Number of segments K
 *   modes           6          Number of modes m that SLIC uses
 *   operator        null       Whose modes: elastic, the body's (eq. 5), or laplacian, the mesh's (eq. 6); null: elastic where
 *                              there is a displacement and the material is known
 *   tau             1.0        Weight of positions against modes, tau of eq. 8
 *   size            null       Size S of a segment in Algorithm 2 [m]; null: from K
 *   iterations      20         Most sweeps of SLIC, up to 10000
 *   connected       true       Whether pieces of a segment apart from its largest one go to a neighbour; in the paper they stay
 *   distance_scale  null       Length that distances to the obstacle are divided by; 0: none, metres as in the paper [m]; null:
 *                              S
 *   mode_scale      null       Factor of modes of root mean square 1, beside positions in metres; 1/sqrt(N) gives them unit
 *                              length on N cells [m]; null: S
 *   margin          0.00001    Share of S by which a centroid must be nearer to take a cell, so that ties of symmetric meshes
 *                              stay; 0 in the paper
 *   obstacles       []         What is the obstacle: patches, or pieces of walls by the names that logs and m4gn segment have
 *                              for them, such as walls:2; []: patches of node type obstacle, else pieces of walls that do not
 *                              reach the box around the mesh, else all walls
 *   overlap         0          Layers of neighbours that segments reach into each other
 *   modal_solver    "auto"     The way to the modes: auto (by size), direct (factorisation) or iterative (multigrid)
 * [end]
 */

/* Whether settings are valid, as far as can be said without a mesh, a model and other ranks: those of m4gn_session_new
 * (kind "session"), m4gn_segments_new ("segments"), m4gn_modes_new ("modes"), m4gn_solid_modes_new ("solid_modes"),
 * m4gn_recorder_new ("recorder") or m4gn_ride_new ("ride"). An
 * entry "others", a list of names that the host reads itself, lets the message name one that is meant. */
int32_t m4gn_options_check(const char* kind, const char* options);

/* ---- mesh and fields ---------------------------------------------------------------------------- */

/* This rank's part of the mesh. Local labels; `empty` patches contribute nothing. A solver with its unknowns at points hands
 * in points for cells, edges for faces, and a boundary face at each point of a patch. */
typedef struct m4gn_mesh_data
{
    int32_t n_directions;  /* 2 or 3 solved directions */
    int32_t directions[3]; /* which: 0 x, 1 y, 2 z */

    int32_t n_cells;
    const int64_t* cell_global; /* [n_cells] number of the cell in the undecomposed mesh, 0-based; a
                                   permutation of 0..N over all ranks */
    const double* cell_centres; /* [3*n_cells] m */
    const double* cell_volumes; /* [n_cells] m^3 */

    int32_t n_faces;               /* internal faces of this rank */
    const int32_t* face_owner;     /* [n_faces] */
    const int32_t* face_neighbour; /* [n_faces] */
    const double*
        face_coeff; /* [n_faces] |off-diagonal| of the solver's Laplacian with unit diffusivity, m */

    int32_t n_boundary;             /* faces of patches that carry values (neither empty nor coupled) */
    const int32_t* boundary_owner;  /* [n_boundary] cell */
    const int64_t* boundary_global; /* [n_boundary] number among all such faces in the undecomposed mesh;
                                        a permutation of 0..B over all ranks */
    const double* boundary_centres; /* [3*n_boundary] m */
    const double* boundary_area;    /* [3*n_boundary] outward area vector, m^2 */
    const double* boundary_coeff;   /* [n_boundary] diagonal contribution of a Dirichlet condition, m */
    const int32_t* boundary_type;   /* [n_boundary] M4GN_WALL ... M4GN_FREE */
    const int32_t* boundary_patch;  /* [n_boundary] index into patch_names */

    int32_t n_coupled;             /* faces of processor and translational cyclic patches, one entry a side */
    const int32_t* coupled_owner;  /* [n_coupled] cell on this side */
    const int32_t* coupled_rank;   /* [n_coupled] rank of the cell on the other side */
    const int64_t* coupled_global; /* [n_coupled] cell_global of the cell on the other side */
    const double*
        coupled_delta; /* [3*n_coupled] from this cell's centre to the other's through the coupling, m */
    const double* coupled_coeff; /* [n_coupled] as face_coeff */

    int32_t n_patches;
    const char* const* patch_names; /* [n_patches] */

    int32_t n_modes; /* modes of the elastic body (m4gn_solid_modes_new), of which segments are then made;
                                   0: none are given */
    const double*
        mode_eigenvalues; /* [n_modes] 1/s^2, ascending; a repeated one whole; the same on all ranks */
    const double*
        mode_cells; /* [3*n_cells*n_modes] mode after mode, the displacement of each cell: the mean of its
                                   points' */

    /* A body that deforms, by its points. cell_type says so: the cells are then the body's points, cell_centres their
     * positions at rest; cell_volumes is not read; n_faces, n_boundary and n_coupled are 0, for edges and volumes follow
     * from the elements. NULL on all ranks: the cells of a mesh that does not move. */
    const int32_t*
        cell_type;      /* [n_cells] M4GN_BODY (free) or M4GN_HANDLE (held); not NULL even without cells */
    int32_t n_elements; /* elements of this rank; each element of the body is one rank's */
    const int32_t*
        element_kind; /* [n_elements] VTK's codes: 10 tetrahedron, 12 hexahedron, 13 wedge, 14 pyramid */
    const int64_t* element_points;  /* cell_global of the elements' points, element after element */
    const double* element_material; /* [3*n_elements] Young's modulus Pa, Poisson's ratio, density kg/m^3 */
    int32_t n_obstacle; /* points of a rigid obstacle, whole and the same on all ranks; 0: there is none */
    const double* obstacle_positions; /* [3*n_obstacle] where its displacement is 0, m */
    int32_t n_obstacle_triangles;
    const int32_t*
        obstacle_triangles; /* [3*n_obstacle_triangles] points of its closed surface, normals outward */
} m4gn_mesh_data;

/* ---- state -------------------------------------------------------------------------------------- */

/* Where an array has its values. */
enum
{
    M4GN_CELLS = 0,   /* the nodes of a solver with its unknowns in cells */
    M4GN_POINTS = 1,  /* the nodes of a solver with its unknowns at mesh points */
    M4GN_FACES = 2,   /* internal faces, or any other items */
    M4GN_BOUNDARY = 3 /* boundary faces: first those of m4gn_mesh_data, in their order; others may follow */
};

/* What an array is to a surrogate. */
enum
{
    M4GN_SOLVED =
        0, /* at the nodes, with an equation in time: it is advanced and measured; a fit is made of it */
    M4GN_FOLLOWS =
        1, /* at the nodes, and follows from the solved ones (an incompressible pressure): it is advanced and measured */
    M4GN_CARRIED =
        2, /* neither is measured (fluxes, boundary values): a fit advances it with the solved ones */
    M4GN_PRESCRIBED =
        3, /* the host knows its values at later times (m4gn_host.ahead): no surrogate advances it */
    M4GN_HELD =
        4 /* one number a boundary face, of the field of this name: not 0 where the face holds its value, 0 where it has that
                       of its cell. Without such an array all faces hold theirs. Read in mode observe */
};

/* An array of the solver's state on this rank. Vectors are three doubles, tensors nine, item after item. The boundary values of a
 * field are the array with its name at M4GN_BOUNDARY. */
typedef struct m4gn_array
{
    const char* name;   /* unique among the arrays of its place and role */
    int32_t place;      /* M4GN_CELLS ... M4GN_BOUNDARY */
    int32_t role;       /* M4GN_SOLVED ... M4GN_HELD */
    int32_t components; /* numbers an item */
    int32_t
        solved; /* of SOLVED and FOLLOWS: components that are solved, fewer where a direction is empty; else not read */
    int64_t n;    /* items of this rank */
    double floor; /* least value that is physical (0 of a temperature in K); -HUGE_VAL: there is none */
    const double* weights; /* [n] of SOLVED: volumes of the nodes, which a fit is weighted by; NULL: 1 each */
} m4gn_array;

/* ---- surrogate ---------------------------------------------------------------------------------- */

/* A model as it was when its file was read: segments and sessions that are made of it are of one model, whatever happens to the
 * file meanwhile. Free it when nothing more is to be made of it; a session keeps what it needs. */
typedef struct m4gn_model m4gn_model;

/* Collective. The first rank reads the file and hands it to all. On failure *model is NULL; M4GN_ERROR_FILE for what is no model:
 * a folder, a pipe, a header that does not fit the file. */
int32_t m4gn_model_open(int32_t comm, const char* path, m4gn_model** model);

/* NULL is none. */
void m4gn_model_free(m4gn_model* model);

/* How many modes of the elastic body the mesh must have for this model's segments; 0: none, they are of the Laplacian's or of no
 * modes. */
int32_t m4gn_model_n_elastic_modes(const m4gn_model* model);

typedef struct m4gn_session m4gn_session;

/* Collective. Builds graph, modes and segments for a model, the same on all ranks. On failure *session is NULL. The settings are
 *
 * [table session]
 *   name        default   meaning
 *   backend     "native"  What runs the network: native; torch, libtorch on a device of its choice; or torch:DEVICE, such as
 *                         torch:cuda:0
 *   precision   "fp32"    Precision of the native backend's products: fp32, bf16, auto (the faster one on the processors of all
 *                         ranks), or model (auto for a model of fields at cells that was trained in bf16, else fp32)
 *   resolution  "auto"    Mean distance of the network's nodes: auto, what the model was trained on; off, a node a cell; or a
 *                         length, m, to which the cells of finer meshes are agglomerated
 *   n_threads   1         Threads of each rank
 *   segments    {}        How the mesh is cut (object): what differs from the segmentation that the model was trained with; {}:
 *                         as the model was trained
 *   solid       null      What the solver says of a solid at cells, compared with what the model was trained on (object):
 *                         lowest and highest E, nu, rho and traction, lists laws and schemes, each optional; null: what the
 *                         case says
 * [end]
 */
int32_t m4gn_session_new(
    int32_t comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI; duplicated */
    const m4gn_mesh_data* mesh, const m4gn_model* model, const char* options,
    const int32_t* cell_segment, /* [n_cells] segments computed before (m4gnSegment); NULL: compute */
    m4gn_session** session);

/* Collective. */
void m4gn_session_free(m4gn_session* session);

/* Time that one step advances, s. */
double m4gn_session_stride(const m4gn_session* session);

/* Segments K of this session. */
int32_t m4gn_session_n_segments(const m4gn_session* session);

/* Fields of the model, in its order; index 0 to n-1. */
int32_t m4gn_session_n_fields(const m4gn_session* session);

/* A field of a model, or of a recording. */
typedef struct m4gn_field_info
{
    const char* name;      /* of a model: valid while the session lives */
    int32_t components;    /* 1 or 3 */
    int32_t dimensions[7]; /* dimensionSet exponents */
    int32_t is_input;      /* of a model, and is_output too */
    int32_t is_output;
} m4gn_field_info;

int32_t m4gn_session_field(const m4gn_session* session, int32_t index, m4gn_field_info* info);

/* Segment of each cell [n_cells], 0 to K-1. */
int32_t m4gn_session_segments(const m4gn_session* session, int32_t* cell_segment);

/* Groups of cells that the network lives on, of all ranks; 0: it lives on the cells themselves. */
int32_t m4gn_session_n_groups(const m4gn_session* session);

/* Group of each cell [n_cells], 0 to n_groups-1; the same on any number of ranks. M4GN_ERROR_INPUT where there are none. */
int32_t m4gn_session_groups(const m4gn_session* session, int32_t* cell_group);

/* How the segments were computed, to be stored with them; "" if they were handed in. Valid while the session lives. */
const char* m4gn_session_segment_record(const m4gn_session* session);

/* Collective. One step from time t to t + stride, fields in the order of m4gn_session_field. */
int32_t m4gn_session_step(
    m4gn_session* session,
    /* [n_fields] values of each input [components*n_cells]; of other fields NULL */
    const double* const* cells,
    /* [n_fields] of each input [components*n_boundary]; of a body the displacement of its obstacle's points at the start and then at
     * the end of the step [2*3*n_obstacle], of which that of the first rank counts */
    const double* const* boundary,
    /* [n_fields] of each output [components*n_cells], which may be the array in cells; of other fields NULL. Components that are not
     * solved stay. After an error (M4GN_ERROR_NUMERICAL: the result is not finite) all stay */
    double* const* next);

/* Collective. In how many respects the case lies outside of what the model was trained on: cell size, speed, Courant number
 * of the stride and inputs by more than a quarter of their range, a solid's moduli and largest traction by more than 2 %, its
 * laws and schemes by name. What a solid at cells is, the host says in the options (solid); a body at points says Poisson's
 * ratio with its elements. Before the first step there are no fields to look at: cell size and solid alone. One a line in why,
 * ended by a zero byte. 0 for a model that does not say what it was trained on. */
int32_t m4gn_session_outside(
    const m4gn_session* session, int32_t* count, char* why, /* [why_size] */
    int32_t why_size);

/* ---- ride --------------------------------------------------------------------------------------- */

/* A hybrid run: the host's solver works, surrogates are measured beside it, one takes its place for a jump of some strides, and hands
 * back. The ride knows no solver: it is told what happened and answers what to do next. What crosses is the state, arrays that
 * m4gn_ride_new describes, as a list of pointers in their order.
 *
 *     answer of             action                     the host
 *     m4gn_ride_handed_back M4GN_RIDE_SOLVE            lets its solver make a step, and calls m4gn_ride_solved
 *     m4gn_ride_solved      SOLVE or STRIDE            saves the ride where it writes its own state; on M4GN_RIDE_STRIDE calls
 *                                                      m4gn_ride_stride
 *     m4gn_ride_stride      ADVANCE, HAND_BACK, SOLVE  on M4GN_RIDE_ADVANCE advances its time by `duration` and its fields to the
 *                                                      prediction, and calls m4gn_ride_advanced
 *     m4gn_ride_advanced    STRIDE or HAND_BACK        saves the ride where it writes its own state; on M4GN_RIDE_HAND_BACK leaves
 *                                                      the fields as its solver needs them, and calls m4gn_ride_handed_back
 *
 * A call that is not due is M4GN_ERROR_INPUT. Figures of the host are the same on all ranks. examples/hybrid_host is
 * such a host. */
typedef struct m4gn_ride m4gn_ride;

enum
{
    M4GN_RIDE_SOLVE = 0,
    M4GN_RIDE_STRIDE = 1,
    M4GN_RIDE_ADVANCE = 2,
    M4GN_RIDE_HAND_BACK = 3
};

/* Where the host is. */
typedef struct m4gn_ride_step
{
    double time;        /* s */
    double delta_t;     /* of the solver, s; not read within a jump */
    double end_time;    /* of the run, s; HUGE_VAL: none */
    double output_time; /* the time as tables have it */
    /* Number of the solver's time step, in which a stride counts as the steps that it stands for */
    int64_t index;
    const char* name;        /* of the time, in messages; NULL: its value */
    int32_t correctors;      /* that the solver took in this step; -1: it has none */
    int32_t most_correctors; /* its cap of them; -1: it has none */
    /* Time after which the next state of a jump is wanted, s: a fit's strides are cut there, at a time step of the solver; 0: at the
     * end of a stride */
    double within;
} m4gn_ride_step;

typedef struct m4gn_ride_answer
{
    double duration;      /* of ADVANCE, STRIDE: time by which the stride, or the part of it, advances, s */
    double delta_t;       /* within a jump the solver's time step, s; else 0 */
    int64_t solver_steps; /* of ADVANCE: time steps of the solver that it stands for */
    int32_t action;       /* M4GN_RIDE_SOLVE ... */
    int32_t surrogate;    /* which one jumps, in the order of the setting surrogates */
    /* Of the jump that are left; of HAND_BACK those that a run takes which is carried on: this one was stopped in the jump */
    int32_t strides;
    int32_t last_but_one; /* 1: one stride is left, whose state is handed back */
    /* 1: m4gn_ride_advanced or m4gn_ride_handed_back, where that is next, needs the state; 0: NULL will do */
    int32_t state;
    /* Of ADVANCE: 1: all arrays that are not prescribed were written; 0: those that the surrogate advances */
    int32_t whole;
    int32_t stepped; /* 1: the model has taken a stride, beside the solver or in its place */
} m4gn_ride_answer;

/* What a host tells of a jump, for the log and the table. */
typedef struct m4gn_ride_quantity
{
    const char* name;
    double value;
} m4gn_ride_quantity;

/* A surrogate of the host's own: a table, another library. */
typedef struct m4gn_surrogate
{
    const char* name;          /* in messages and tables */
    double stride;             /* time that a step advances, s */
    int32_t n_fields;          /* SOLVED and FOLLOWS arrays that it advances */
    const char* const* fields; /* [n_fields] their names, each once */
    /* One step: `state` has all arrays of the ride at its start, `next` the places of those that it advances, which hold the start's
     * values, and NULL for the others. A status; M4GN_ERROR_NUMERICAL where there is no result. All ranks are called. */
    int32_t (*step)(void* data, const double* const* state, double* const* next);
    void* data; /* kept until the ride is freed, and handed to step */
} m4gn_surrogate;

/* What the host brings along. Pointers are read during m4gn_ride_new, but for those that are said to be kept. */
typedef struct m4gn_host
{
    m4gn_session*
        session; /* of the surrogate "network": its model; NULL: there is none. It is kept: it must live as long as the ride,
                              and the host may go on using it between calls */
    const m4gn_surrogate* own;  /* or one of the host's own in its place */
    const m4gn_mesh_data* mesh; /* of the session or the host's own surrogate; NULL: there is neither */
    const m4gn_array*
        arrays; /* [n_arrays] what the state consists of: at least what the surrogates read and advance; of a fit, all
                                   that the solver goes on from */
    int32_t n_arrays;
    /* What the PRESCRIBED arrays will be a time `later` (s) from the present one: arrays[i] has room for array i, or is NULL. A status.
     * Kept; NULL: their values do not change. All ranks are called. */
    int32_t (*ahead)(void* data, double later, double* const* arrays);
    void* data; /* kept until the ride is freed, and handed to ahead */
} m4gn_host;

/* Collective. Begins a ride at the present time, `start`. On failure *ride is NULL. All ranks have a session, or none; the ride is on the
 * session's communicator, without one on comm. The settings are
 *
 * [table ride]
 *   name             default      meaning
 *   mode             required     replace: surrogates take over stretches of time steps; observe: they run beside the solver,
 *                                 and their errors are reported
 *   surrogates       ["network"]  network, a trained model; dmd, which is fitted to the run's own states and needs no model; or
 *                                 both: the network jumps until a fit holds, then the fit; ["network"]: network
 *   dmd              null         Settings of the dmd surrogate (object); null: its defaults
 *   solver_steps     null         replace: time steps of the solver before each jump; null: required in mode replace; with dmd
 *                                 1
 *   surrogate_steps  null         replace: strides of each jump; with control, the most; null: required in mode replace; with
 *                                 dmd max_jump
 *   rollout_steps    50           observe: strides after which a rollout begins anew
 *   write_errors     false        observe: writes the errors of rollouts at each cell and in each segment
 *   time_start       null         Time before which the solver runs alone [s]; null: start of the run
 *   time_end         null         Time after which the solver runs alone [s]; null: end of the run
 *   control          null         Error control of jumps (object); observe: what it would have allowed; null: all jumps have
 *                                 surrogate_steps strides; with dmd in mode replace tolerance 0.05
 *   quantities       []           replace: results of other function objects whose errors at the ends of jumps are limited
 *                                 (list of dictionaries); []: none
 *   write_precision  6            Significant digits of tables and messages
 *   decisions        null         File of the decisions, lines of JSON; null: nowhere
 *   states           null         Where the dmd surrogate keeps its states, a file a rank; null: nowhere
 *   name             ""           Name of the ride in messages
 *   model            ""           Where the model is from, in messages and tables
 *   host             ""           Any text that the host keeps in the state for itself, of the first rank
 *   setup_seconds    0.0          Wall time that making the surrogates took, for the summary [s]
 * [end]
 *
 * those of control (docs/explanation/hybrid-run.md)
 *
 * [table control]
 *   name        default   meaning
 *   tolerance   required  Largest error of a jump: root mean square, over the largest variation of the field so far in the run
 *                         (its root mean square, of a scalar about its mean)
 *   rel_tol     0.2       Largest error of a stride beside the solver, over what the solver changed in it
 *   fields      null      Predicted fields whose errors are limited; null: the first that varies; with several surrogates the
 *                         first that all predict
 *   on_failure  "solver"  What happens after patience: with solver it goes on alone, with the surrogate measured beside it;
 *                         stop ends the run with an error
 *   patience    10        Measured strides in a row that allow no jump, after which on_failure applies
 * [end]
 *
 * those of an object of quantities
 *
 * [table quantities]
 *   name       default   meaning
 *   object     required  Name of the function object whose result it is
 *   result     required  Name of the result
 *   tolerance  required  Largest error at the end of a jump, over the result's variation
 * [end]
 *
 * and those of dmd (docs/explanation/dmd.md)
 *
 * [table dmd]
 *   name               default     meaning
 *   snapshot_interval  null        Time between snapshots, the stride: a tenth to a twentieth of the flow's period [s]; null:
 *                                  found in the run: ten of the longest recent time steps, doubled while a period that fits
 *                                  show has more than 28 snapshots
 *   window             null        Most snapshots in a fit, up to 1000; null: 40, and 160 where boundary values are prescribed
 *                                  in time
 *   min_snapshots      null        Fewest snapshots without a gap that a fit needs; null: window, where it is given, else 40
 *   hold_out           5           Snapshots at the end of the window that are held out, to choose delays and svd_rank by
 *   delays             [5, 8, 12]  Candidates for the number of snapshots in a delayed one (higher-order DMD)
 *   svd_rank           [12, 30]    Candidates for the rank of the truncated singular value decomposition
 *   unstable_modes     null        Whether modes may grow; else a growth rate above 0 counts as 0; null: chosen by the held-out
 *                                  snapshots
 *   refit_interval     5           Strides of the solver between two fits
 *   fit_tolerance      0.005       Error of the held-out snapshots, over that of holding the last one before them, below which
 *                                  a fit is used at once; between this and jump_tolerance it is used if the three fits before
 *                                  were about as good. A stride beside the solver with an error below this, or below twice the
 *                                  fit's, makes the next jump longer, else shorter
 *   jump_tolerance     0.02        Largest error of the held-out snapshots, and of a stride beside the solver after a jump,
 *                                  over that of holding the last state
 *   rest               {}          Fields, each with a change (root mean square, in its unit) that counts as none (rest { U
 *                                  1e-4; }): errors are relative to the flow's change, but at least to this; {}: a
 *                                  ten-thousandth of the most that a field has changed by since the first state
 *   cut_transient      false       Whether a start-up is cut short: a wave that grows or decays is brought to its final
 *                                  amplitude. Until it has settled, the run differs from the plain one
 *   write_modes        0           Number of modes of the fit that are written as fields, the largest first, with their mean
 *   initial_jump       10          Strides of the first jump of a fit
 *   jump_growth        1.5         Largest ratio of a jump to the one before
 *   max_jump           200         Most strides of a jump, up to a million
 *   storage            "double"    Precision of stored snapshots: double or single; sums are in double
 *   keep               true        Whether snapshots are stored on disk for restarts
 * [end]
 */
int32_t m4gn_ride_new(
    int32_t
        comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI; duplicated. Not read with a session */
    const m4gn_host* host, const char* options, const m4gn_ride_step* start, m4gn_ride** ride);

/* Collective. */
void m4gn_ride_free(m4gn_ride* ride);

/* Whether m4gn_ride_solved needs the state after this step: *wants is 1 or 0. */
int32_t m4gn_ride_wants(const m4gn_ride* ride, const m4gn_ride_step* now, int32_t* wants);

/* Collective. The solver has made a step. M4GN_ERROR_INPUT too where strides would be compared at times at which none ends, since the ride
 * is not told of each step; M4GN_ERROR_NUMERICAL where the surrogates stay bad and control says stop. */
int32_t m4gn_ride_solved(
    m4gn_ride* ride, const m4gn_ride_step* now, const double* const* state, m4gn_ride_answer* answer);

/* Collective. A stride from the present state. Where the action is M4GN_RIDE_ADVANCE, next has the arrays that the surrogate advances;
 * others stay. next[i] is the place of array i, and NULL of a prescribed one; no two may overlap. */
int32_t m4gn_ride_stride(m4gn_ride* ride, double* const* next, m4gn_ride_answer* answer);

/* Collective. Time and fields are those of the prediction. */
int32_t m4gn_ride_advanced(
    m4gn_ride* ride, const m4gn_ride_step* now, const double* const* state, m4gn_ride_answer* answer);

/* Within a jump whose surrogate is a fit: the state a time `before` (s) the present one, where the solver's time scheme has an old level.
 * arrays[i] is the place of array i, and NULL of one that is prescribed or has no old level. M4GN_ERROR_INPUT for a surrogate that does not
 * know it. */
int32_t m4gn_ride_old_level(const m4gn_ride* ride, double before, double* const* arrays);

/* With the setting quantities: what they are after the present state, in their order, NAN where there is none. Behind m4gn_ride_solved,
 * and after m4gn_ride_advanced; behind m4gn_ride_load too, where the state was saved before they were reported. What is reported again of a
 * state does not count. The same on all ranks. */
int32_t m4gn_ride_reported(m4gn_ride* ride, const double* values, int32_t n_values);

/* Wall time since the last such call that went into strides and into handing over, s. */
int32_t m4gn_ride_spent(m4gn_ride* ride, double surrogate, double hand_over);

/* Collective. The solver goes on from this state. */
int32_t m4gn_ride_handed_back(
    m4gn_ride* ride, const m4gn_ride_step* now, const double* const* state,
    const m4gn_ride_quantity* quantities, int32_t n_quantities, m4gn_ride_answer* answer);

/* What the run is made under, by name: the text of a JSON object of texts and lists of figures (boundary conditions, properties, schemes).
 * To be told before load and save. The same on all ranks. */
int32_t m4gn_ride_conditions(m4gn_ride* ride, const char* conditions);

/* Collective. One file, which the first rank writes and reads: a ride that takes it up, on a host that has the state of that time, goes
 * on as the uninterrupted one. What was fitted and measured under other conditions is dropped, the log names what has changed, and the
 * action is M4GN_RIDE_SOLVE. To be saved where the table above says so. The action of load is M4GN_RIDE_SOLVE, M4GN_RIDE_STRIDE
 * where strides of a jump are left, or M4GN_RIDE_HAND_BACK where the state is one that was handed back already. A network goes on on
 * another number of ranks. M4GN_ERROR_INPUT where states of dmd are missing, as they are there; M4GN_ERROR_FILE for a file that is damaged
 * (it has a checksum) or of another mesh or time, M4GN_ERROR_MODEL for one of another model: the ride then begins anew. */
int32_t m4gn_ride_save(m4gn_ride* ride, const char* path);
int32_t m4gn_ride_load(
    m4gn_ride* ride, const char* path, const m4gn_ride_step* now, const double* const* state,
    m4gn_ride_answer* answer);

/* Not collective. As much as fits of the text that the host keeps in a state, ended by a zero byte: to be read before a ride is made. */
int32_t m4gn_ride_host(const char* path, char* text, int32_t size);

enum
{
    M4GN_RIDE_LOG = 0,            /* lines of the log */
    M4GN_RIDE_WARNING = 1,        /* one warning */
    M4GN_RIDE_JUMPS = 2,          /* rows of the table of jumps */
    M4GN_RIDE_STRIDES = 3,        /* rows of the table of strides beside the solver */
    M4GN_RIDE_ERRORS = 4,         /* mode observe: rows of the table of errors */
    M4GN_RIDE_SEGMENT_ERRORS = 5, /* and of that of errors in segments */
    M4GN_RIDE_SUMMARY =
        6, /* ends the ride: totals go into the log, and in mode replace into this JSON object */
    M4GN_RIDE_DIFFERENCE_TIME = 7, /* name of the time of m4gn_ride_difference */
    M4GN_RIDE_MODES = 8            /* rows of the table of the modes of fits that are used */
};

/* Takes what there is to be said, "" if there is nothing. A table's first rows come with its head. Valid until the next call. */
const char* m4gn_ride_text(m4gn_ride* ride, int32_t kind);

/* Of the fit that a surrogate has in use, in an array that it advances, [components*n]: what does not oscillate now (part 0), what a wave, from 0,
 * the largest first, adds (1), and a quarter of its period before (2); of wave 0 the root mean square of what all waves add (3).
 * M4GN_ERROR_INPUT: there is no such wave. */
int32_t m4gn_ride_wave(
    const m4gn_ride* ride, int32_t surrogate, int32_t wave, int32_t part, int32_t array, double* values);

/* Mode observe with write_errors: rollout of a surrogate minus solver of an array that it advances, [components*n], where they were
 * compared last. M4GN_ERROR_INPUT before. */
int32_t m4gn_ride_difference(const m4gn_ride* ride, int32_t surrogate, int32_t array, double* values);

/* ---- segments ----------------------------------------------------------------------------------- */

/* Segments of a mesh without a model, and its Laplacian modes. */
typedef struct m4gn_segments m4gn_segments;

/* Collective. Cuts the mesh; on failure *segments is NULL. The settings are
 *
 * [table segments_request]
 *   name        default  meaning
 *   segments    {}       How the mesh is cut (object): what differs from the model's segmentation, without a model from the
 *                        defaults; {}: nothing
 *   with_modes  false    Whether modes are computed and kept
 * [end]
 */
int32_t m4gn_segments_new(
    int32_t comm, const m4gn_mesh_data* mesh,
    const m4gn_model* model, /* whose segmentation is meant; NULL: the default one */
    const char* options,
    const int32_t* cell_segment, /* [n_cells] segments computed before (m4gnSegment); NULL: compute */
    m4gn_segments** segments);

void m4gn_segments_free(m4gn_segments* segments);

/* How they were computed, to be stored with them; "" if they were handed in. Valid while the segments live. */
const char* m4gn_segments_record(const m4gn_segments* segments);

/* Collective. Whether cell_segment, which was stored, is what the settings describe on this mesh, as far as the record that
 * was stored with it says: the model's segmentation with the entries of segments, or without a model those entries alone.
 * *fit is 1, or 0 and why, ended by a zero byte, says what differs. A model without segments takes any. */
int32_t m4gn_segments_fit(
    int32_t comm, const m4gn_mesh_data* mesh,
    const m4gn_model* model,                          /* as of m4gn_segments_new, and so the options */
    const char* options, const int32_t* cell_segment, /* [n_cells]; not NULL */
    const char* record,      /* from m4gn_segments_record; NULL or "": none was stored. Rank 0's counts */
    int32_t* fit, char* why, /* [why_size] */
    int32_t why_size);

/* Segments K. */
int32_t m4gn_segments_n_segments(const m4gn_segments* segments);

/* Segment of each of this rank's cells [n_cells], 0 to K-1. */
int32_t m4gn_segments_cells(const m4gn_segments* segments, int32_t* cell_segment);

/* Modes: as many as spec says, more if the last eigenvalue is repeated. */
int32_t m4gn_segments_n_modes(const m4gn_segments* segments);

/* Mode index (0 to n-1, by ascending eigenvalue): eigenvalue, 1/m^2, and the mode in this rank's cells [n_cells],
 * scaled to sum V phi^2 = sum V. Of an elastic body the solved components of each of its modes follow each other,
 * each with the eigenvalue, 1/s^2. */
int32_t m4gn_segments_mode(const m4gn_segments* segments, int32_t index, double* eigenvalue, double* cells);

typedef struct m4gn_rank_report
{
    double cut;       /* faces between segments of different ranks */
    double imbalance; /* largest load over its rank's share; 1: perfect */
} m4gn_rank_report;

/* Not collective; a function of its arguments alone. The rank of each segment, so that every rank has at least one,
 * loads are balanced and few faces lie between ranks. n_segments < n_ranks is an error. */
int32_t m4gn_segment_ranks(
    int32_t n_segments, const double* sizes, /* [n_segments] nodes, or any other work */
    const double* adjacency,                 /* [n_segments*n_segments] faces from one segment to another */
    int32_t n_ranks, const double* rank_weights, /* [n_ranks] shares of the work, of any sum; NULL: equal */
    int32_t* segment_rank,                       /* [n_segments] */
    m4gn_rank_report* report);                   /* may be NULL */

/* ---- modes -------------------------------------------------------------------------------------- */

/* Modes of a solver's own pair of matrices: K phi = lambda M phi. */
typedef struct m4gn_modes m4gn_modes;

/* This rank's rows of a distributed square matrix. Rows and columns are numbered over all ranks, the rows of rank 0
 * first, then those of rank 1, and so on. */
typedef struct m4gn_csr
{
    int32_t n_rows;        /* rows of this rank; may be 0 */
    const int64_t* row;    /* [n_rows+1] row i holds entries row[i] to row[i+1]-1; row[0] is 0 */
    const int64_t* column; /* [row[n_rows]] columns, in any order within a row; entries of one place add up */
    const double* value;   /* [row[n_rows]] */
} m4gn_csr;

/* Collective. Solves for the modes of K and M that are symmetric and positive semi-definite; M may be singular, NULL is the
 * identity. On failure *modes is NULL. The settings are
 *
 * [table modes]
 *   name          default  meaning
 *   modes         6        Number of modes; repeated eigenvalues are taken whole, so there may be more
 *   modal_solver  "auto"   The way to the modes: auto (by size), direct (factorisation) or iterative (multigrid)
 *   block         1        Unknowns a point, in consecutive rows
 *   shift         null     A number a little below the eigenvalues that are wanted; null: estimated
 * [end]
 */
int32_t m4gn_modes_new(
    int32_t comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI */
    const m4gn_csr* stiffness, const m4gn_csr* mass, const char* options,
    const double*
        positions, /* [3*n_rows/block] where the points are, m: signs of modes then do not depend on the
                                   numbering. NULL on all ranks: chosen by numbers */
    m4gn_modes** modes);

void m4gn_modes_free(m4gn_modes* modes);

/* Number of modes found. */
int32_t m4gn_modes_n_modes(const m4gn_modes* modes);

/* Eigenvalues [count], ascending. */
int32_t m4gn_modes_eigenvalues(const m4gn_modes* modes, double* eigenvalues);

/* Mode `index`, 0 to count-1, of this rank's rows [n_rows]; scaled to phi^T M phi = (sum of the entries of M)/block,
 * a root mean square of 1. */
int32_t m4gn_modes_vector(const m4gn_modes* modes, int32_t index, double* vector);

/* ---- modes of elastic bodies --------------------------------------------------------------------- */

/* This rank's part of an elastic body: isotropic, linear, with its displacements on the points of the mesh. Finite
 * elements for cells of any shape; docs/explanation/segments.md says which. Labels are local; all zero but what is needed is fine. */
typedef struct m4gn_solid
{
    int32_t n_directions;  /* 3, or 2 on a mesh that is one cell thick in the third */
    int32_t directions[3]; /* which: 0 x, 1 y, 2 z */

    int32_t n_points;
    const int64_t*
        point_global;     /* [n_points] number of the point, 0 to N-1, the same on every rank that has it */
    const double* points; /* [3*n_points] m */

    int32_t n_faces; /* internal faces first */
    int32_t n_internal_faces;
    const int32_t*
        face_start; /* [n_faces+1] points of face f: face_points[face_start[f]] to [face_start[f+1]-1] */
    const int32_t* face_points;    /* around each face; the right-hand normal leaves the owner */
    const int32_t* face_owner;     /* [n_faces] cell */
    const int32_t* face_neighbour; /* [n_internal_faces] cell */

    int32_t n_cells;
    const double* young;   /* [n_cells] Young's modulus, Pa */
    const double* poisson; /* [n_cells] Poisson's ratio, above -1 and below 0.5 */
    const double* density; /* [n_cells] kg/m^3 */

    int32_t n_fixed;                 /* held points; one that any rank holds is held */
    const int32_t* fixed_point;      /* [n_fixed] */
    const int32_t* fixed_components; /* [n_fixed] sum of 1 (x), 2 (y), 4 (z); NULL: all three */

    int32_t plane_stress; /* 2-D: 0 plane strain, 1 plane stress */
    int32_t free_body;    /* 1: nothing needs to be held; 0: that is an error */
} m4gn_solid;

/* Collective. Modes K phi = omega^2 M phi: eigenvalues in 1/s^2; m4gn_modes_vector gives the displacement (x, y, z) of
 * each point, [3*n_points], scaled to a root mean square of 1 over the body. Of the settings of m4gn_modes_new there are
 * modes and modal_solver. On failure *modes is NULL. */
int32_t m4gn_solid_modes_new(
    int32_t comm, /* MPI_Comm_c2f of the host's communicator, or M4GN_NO_MPI */
    const m4gn_solid* body, const char* options, m4gn_modes** modes);

/* ---- recorder ----------------------------------------------------------------------------------- */

typedef struct m4gn_recorder m4gn_recorder;

/* Collective. On failure *recorder is NULL. The settings are
 *
 * [table recorder]
 *   name        default   meaning
 *   path        required  Final name of the HDF5 file; written beside it first, renamed when whole
 *   split       "train"   What the trajectory is for: train, valid or test
 *   overwrite   false     Whether an existing file is replaced; else it is an error
 *   provenance  {}        Entries that are kept with the data, such as application and case (object); those of the first rank
 *                         count; {}: none
 * [end]
 */
int32_t m4gn_recorder_new(
    int32_t comm, const m4gn_mesh_data* mesh, const char* options, const m4gn_field_info* fields,
    int32_t n_fields, m4gn_recorder** recorder);

/* Collective. Appends a frame: of each field, in the order of m4gn_recorder_new, its cells [components*n_cells] and boundary faces
 * [components*n_boundary]; times must increase. */
int32_t m4gn_recorder_append(
    m4gn_recorder* recorder, double time, const double* const* cells, const double* const* boundary);

/* Number of frames so far. */
int64_t m4gn_recorder_n_frames(const m4gn_recorder* recorder);

/* Collective. Completes the file and gives it its final name. Appending is then an error. */
int32_t m4gn_recorder_finish(m4gn_recorder* recorder);

/* Collective. Without a finish before, nothing is left behind. */
void m4gn_recorder_free(m4gn_recorder* recorder);

#ifdef __cplusplus
}
#endif

#endif
