/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * A surrogate that is always right, in front of libm4gn.so (LD_PRELOAD): it records a run in memory order to $ORACLE_FILE
 * and, as a model of the fields that were recorded, gives the frame $ORACLE_FRAMES later back, with a smooth error of $ORACLE_ERROR in the
 * first two components of the first field, and a rough one of $ORACLE_ROUGH, relative to the largest value of a field, in the
 * first two components of all. Each rank has a file of its own. With it, what is left of an error after a jump is that of the
 * hand-over alone. What is not defined here is the library's own, the ride among it.
 */
#define _GNU_SOURCE
#include "m4gn.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MAX_FIELDS = 8, NAME = 64 };

/* The file's header, and then its frames: the fields' cells, one after the other */
struct header
{
    int64_t n_cells;
    int32_t n_fields;
    int32_t components[MAX_FIELDS];
    int32_t dimensions[MAX_FIELDS][7];
    char name[MAX_FIELDS][NAME];
};

static const char* message = "";

static const char* variable(const char* name, const char* otherwise)
{
    const char* value = getenv(name);
    return value ? value : otherwise;
}

static FILE* recording_of(const char* rank, const char* mode)
{
    char path[4096];
    snprintf(path, sizeof(path), "%s%s", variable("ORACLE_FILE", "oracle.bin"), rank);
    return fopen(path, mode);
}

static FILE* recording(const char* mode)
{
    return recording_of(variable("OMPI_COMM_WORLD_RANK", ""), mode);
}

/* The library's function of this name */
static void* real(const char* name)
{
    void* found = dlsym(RTLD_NEXT, name);
    if (!found)
    {
        fprintf(stderr, "oracle: %s: %s\n", name, dlerror());
        exit(1);
    }
    return found;
}

const char* m4gn_last_error(void)
{
    return *message ? message : ((const char* (*)(void))real("m4gn_last_error"))();
}

/* ---- recorder ---- */

struct m4gn_recorder
{
    FILE* file;
    struct header header;
    int64_t n_frames;
};

int32_t m4gn_recorder_new(
    int32_t comm, const m4gn_mesh_data* mesh, const char* options, const m4gn_field_info* fields, int32_t n_fields,
    m4gn_recorder** recorder)
{
    if (n_fields > MAX_FIELDS)
    {
        message = "too many fields";
        return M4GN_ERROR_INPUT;
    }
    m4gn_recorder* r = calloc(1, sizeof(*r));
    r->header.n_cells = mesh->n_cells;
    r->header.n_fields = n_fields;
    for (int32_t i = 0; i < n_fields; ++i)
    {
        r->header.components[i] = fields[i].components;
        memcpy(r->header.dimensions[i], fields[i].dimensions, sizeof(r->header.dimensions[i]));
        snprintf(r->header.name[i], NAME, "%s", fields[i].name);
    }
    r->file = recording("wb");
    *recorder = r;
    return r->file && fwrite(&r->header, sizeof(r->header), 1, r->file) == 1 ? M4GN_OK : M4GN_ERROR_FILE;
}

int32_t m4gn_recorder_append(
    m4gn_recorder* r, double time, const double* const* cells, const double* const* boundary)
{
    for (int32_t i = 0; i < r->header.n_fields; ++i)
    {
        const size_t n = r->header.components[i]*r->header.n_cells;
        if (fwrite(cells[i], sizeof(double), n, r->file) != n)
        {
            return M4GN_ERROR_FILE;
        }
    }
    ++r->n_frames;
    return M4GN_OK;
}

int64_t m4gn_recorder_n_frames(const m4gn_recorder* r) { return r->n_frames; }
int32_t m4gn_recorder_finish(m4gn_recorder* r) { return fclose(r->file) ? M4GN_ERROR_FILE : M4GN_OK; }
void m4gn_recorder_free(m4gn_recorder* r) { free(r); }

/* ---- session ---- */

struct m4gn_session
{
    int32_t comm;
    struct header header;
    size_t frame; /* doubles of a frame */
    size_t start[MAX_FIELDS];
    double size[MAX_FIELDS]; /* largest value of each field, of all ranks */
    long n_frames;
    double* centres;
    double* frames;
    int32_t array[MAX_FIELDS]; /* place of each field in the state of the ride */
};

/* No body has modes here, and no model needs any. */
int32_t m4gn_solid_modes_new(
    int32_t comm, const m4gn_solid* body, const char* options, m4gn_modes** modes)
{
    *modes = NULL;
    return M4GN_OK;
}
void m4gn_modes_free(m4gn_modes* modes) {}
int32_t m4gn_modes_n_modes(const m4gn_modes* modes) { return 0; }
int32_t m4gn_modes_eigenvalues(const m4gn_modes* modes, double* values) { return M4GN_OK; }
/* The model is the recording: nothing of a file is read. */
int32_t m4gn_model_open(int32_t comm, const char* path, m4gn_model** model)
{
    *model = NULL;
    return M4GN_OK;
}
void m4gn_model_free(m4gn_model* model) {}
int32_t m4gn_model_n_elastic_modes(const m4gn_model* model) { return 0; }

int32_t m4gn_options_check(const char* kind, const char* options)
{
    return M4GN_OK;
}

static void find_sizes(m4gn_session* s, int64_t n_cells, const double* values, long n_frames)
{
    for (long f = 0; f < n_frames; ++f)
    {
        for (int32_t i = 0; i < s->header.n_fields; ++i)
        {
            for (int64_t j = 0; j < s->header.components[i]*n_cells; ++j)
            {
                s->size[i] = fmax(s->size[i], fabs(*values++));
            }
        }
    }
}

/* Another rank's recording, which lies beside this one's */
static void add_sizes_of(m4gn_session* s, int rank)
{
    char name[16];
    snprintf(name, sizeof(name), "%d", rank);
    struct header header;
    FILE* file = recording_of(name, "rb");
    if (!file) return;
    if (fread(&header, sizeof(header), 1, file) == 1)
    {
        size_t frame = 0;
        for (int32_t i = 0; i < header.n_fields; ++i) frame += header.components[i]*header.n_cells;
        double* values = malloc(frame*sizeof(double));
        while (fread(values, sizeof(double), frame, file) == frame) find_sizes(s, header.n_cells, values, 1);
        free(values);
    }
    fclose(file);
}

int32_t m4gn_session_new(
    int32_t comm, const m4gn_mesh_data* mesh, const m4gn_model* model, const char* options, const int32_t* cell_segment,
    m4gn_session** session)
{
    m4gn_session* s = calloc(1, sizeof(*s));
    s->comm = comm;
    FILE* file = recording("rb");
    if (!file || fread(&s->header, sizeof(s->header), 1, file) != 1 || s->header.n_cells != mesh->n_cells)
    {
        message = "no recording of this mesh";
        return M4GN_ERROR_FILE;
    }
    for (int32_t i = 0; i < s->header.n_fields; ++i)
    {
        s->start[i] = s->frame;
        s->frame += s->header.components[i]*s->header.n_cells;
    }
    fseek(file, 0, SEEK_END);
    const size_t values = (ftell(file) - sizeof(s->header))/sizeof(double);
    fseek(file, sizeof(s->header), SEEK_SET);
    s->n_frames = values/s->frame;
    s->frames = malloc(values*sizeof(double));
    s->centres = malloc(3*s->header.n_cells*sizeof(double));
    memcpy(s->centres, mesh->cell_centres, 3*s->header.n_cells*sizeof(double));
    const size_t got = fread(s->frames, sizeof(double), values, file);
    fclose(file);
    find_sizes(s, s->header.n_cells, s->frames, s->n_frames);
    for (int rank = 0; rank < atoi(variable("OMPI_COMM_WORLD_SIZE", "0")); ++rank)
    {
        add_sizes_of(s, rank);
    }
    *session = s;
    return got == values ? M4GN_OK : M4GN_ERROR_FILE;
}

void m4gn_session_free(m4gn_session* s)
{
    free(s->frames);
    free(s->centres);
    free(s);
}

double m4gn_session_stride(const m4gn_session* s)
{
    return atof(variable("ORACLE_STRIDE", "0.05"));
}

int32_t m4gn_session_n_segments(const m4gn_session* s) { return 1; }
int32_t m4gn_session_n_groups(const m4gn_session* s) { return 0; }
int32_t m4gn_session_n_fields(const m4gn_session* s) { return s->header.n_fields; }

int32_t m4gn_session_field(const m4gn_session* s, int32_t index, m4gn_field_info* info)
{
    memset(info, 0, sizeof(*info));
    info->name = s->header.name[index];
    info->components = s->header.components[index];
    memcpy(info->dimensions, s->header.dimensions[index], sizeof(info->dimensions));
    info->is_input = info->is_output = 1;
    return M4GN_OK;
}

int32_t m4gn_session_segments(const m4gn_session* s, int32_t* cell_segment)
{
    memset(cell_segment, 0, s->header.n_cells*sizeof(*cell_segment));
    return M4GN_OK;
}

int32_t m4gn_session_groups(const m4gn_session* s, int32_t* cell_group)
{
    return M4GN_ERROR_INPUT;
}

const char* m4gn_session_segment_record(const m4gn_session* s)
{
    return "";
}

int32_t m4gn_session_outside(const m4gn_session* s, int32_t* count, char* why, int32_t why_size)
{
    *count = 0;
    return M4GN_OK;
}

int32_t m4gn_segments_fit(
    int32_t comm, const m4gn_mesh_data* mesh, const m4gn_model* model, const char* options, const int32_t* cell_segment,
    const char* record, int32_t* fit, char* why, int32_t why_size)
{
    *fit = 1;
    if (why_size > 0) why[0] = 0;
    return M4GN_OK;
}

/* 1 or -1, as a cell's place says: the same in a decomposed mesh, and no pattern of the cells around it */
static double sign_of(const double* centre, int32_t component)
{
    const double mixed = 43758.5453*sin(1298.98*centre[0] + 7823.3*centre[1] + 3771.9*centre[2] + 17.3*component);
    return mixed - floor(mixed) < 0.5 ? -1 : 1;
}

static int32_t step(void* data, const double* const* state, double* const* next)
{
    m4gn_session* s = data;
    const int32_t n_fields = s->header.n_fields;
    const int64_t n_cells = s->header.n_cells;
    const long ahead = atol(variable("ORACLE_FRAMES", "25"));
    const double error = atof(variable("ORACLE_ERROR", "0"));
    const double rough = atof(variable("ORACLE_ROUGH", "0"));

    /* The frame that is nearest in all fields */
    long nearest = 0;
    double least = INFINITY;
    for (long f = 0; f < s->n_frames; ++f)
    {
        double sum = 0;
        for (int32_t i = 0; i < n_fields; ++i)
        {
            const double* values = s->frames + f*s->frame + s->start[i];
            const double scale = s->size[i] > 0 ? 1/s->size[i] : 0;
            for (int64_t j = 0; j < s->header.components[i]*n_cells; ++j)
            {
                const double difference = scale*(state[s->array[i]][j] - values[j]);
                sum += difference*difference;
            }
        }
        if (sum < least)
        {
            least = sum;
            nearest = f;
        }
    }
    /* The recording ends before */
    if (nearest + ahead >= s->n_frames) return M4GN_ERROR_NUMERICAL;

    for (int32_t i = 0; i < n_fields; ++i)
    {
        const int32_t n = s->header.components[i];
        double* values = next[s->array[i]];
        memcpy(values, s->frames + (nearest + ahead)*s->frame + s->start[i], n*n_cells*sizeof(double));
        for (int64_t c = 0; c < n_cells; ++c)
        {
            const double* centre = s->centres + 3*c;
            if (i == 0 && n == 3)
            {
                values[3*c] += error*sin(15.7*centre[0])*sin(15.3*centre[1]);
                values[3*c + 1] += error*cos(20.9*centre[0])*sin(15.3*centre[1]);
            }
            for (int32_t k = 0; rough > 0 && k < n && k < 2; ++k)
            {
                values[n*c + k] += rough*s->size[i]*sign_of(centre, k);
            }
        }
    }
    return M4GN_OK;
}

/* ---- ride ---- */

int32_t m4gn_ride_new(
    int32_t comm, const m4gn_host* host, const char* options, const m4gn_ride_step* start, m4gn_ride** ride)
{
    m4gn_session* s = host->session;
    const char* names[MAX_FIELDS];
    for (int32_t i = 0; i < s->header.n_fields; ++i)
    {
        names[i] = s->header.name[i];
        s->array[i] = -1;
        for (int32_t j = 0; j < host->n_arrays; ++j)
        {
            const m4gn_array* array = &host->arrays[j];
            if (array->place <= M4GN_POINTS && !strcmp(array->name, names[i])) s->array[i] = j;
        }
        if (s->array[i] < 0)
        {
            message = "a field of the recording is not in the state";
            return M4GN_ERROR_INPUT;
        }
    }
    const m4gn_surrogate own = {"oracle", m4gn_session_stride(s), s->header.n_fields, names, step, s};
    m4gn_host found = *host;
    found.session = NULL;
    found.own = &own;
    int32_t (*begin)(int32_t, const m4gn_host*, const char*, const m4gn_ride_step*, m4gn_ride**) =
        (int32_t(*)(int32_t, const m4gn_host*, const char*, const m4gn_ride_step*, m4gn_ride**))real("m4gn_ride_new");
    return begin(s->comm, &found, options, start, ride);
}
