/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * A libm4gn.so whose surrogate is always right: it records a run in memory order to $ORACLE_FILE and, as a model,
 * gives the recorded fields back a stride later, with a smooth error of $ORACLE_ERROR m/s. One rank, fields U and p.
 * With it, what is left of an error after a jump is that of the hand-over alone.
 */
#include "m4gn.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const char* message = "";

static const char* variable(const char* name, const char* otherwise)
{
    const char* value = getenv(name);
    return value ? value : otherwise;
}

int32_t m4gn_abi_version(void) { return M4GN_ABI_VERSION; }
const char* m4gn_version(void) { return "oracle"; }
const char* m4gn_last_error(void) { return message; }

/* ---- recorder: the frames of U and p, one after the other ---- */

struct m4gn_recorder
{
    FILE* file;
    size_t n_cells;
    int64_t n_frames;
};

int32_t m4gn_recorder_new(
    int32_t comm, const m4gn_mesh_data* mesh, const m4gn_recorder_options* options, m4gn_recorder** recorder)
{
    (void)comm;
    (void)options;
    *recorder = calloc(1, sizeof(**recorder));
    (*recorder)->n_cells = mesh->n_cells;
    (*recorder)->file = fopen(variable("ORACLE_FILE", "oracle.bin"), "wb");
    return (*recorder)->file ? M4GN_OK : M4GN_ERROR_FILE;
}

int32_t m4gn_recorder_append(m4gn_recorder* r, double time, const m4gn_field* fields, int32_t n_fields)
{
    (void)time;
    for (int32_t i = 0; i < n_fields; ++i)
    {
        const size_t n = fields[i].components*r->n_cells;
        if (fwrite(fields[i].cells, sizeof(double), n, r->file) != n)
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
    size_t n_cells;
    long n_frames;
    double* centres;
    double* frames; /* [n_frames][3*n_cells U, n_cells p] */
};

void m4gn_session_options_init(m4gn_session_options* options) { memset(options, 0, sizeof(*options)); }

int32_t m4gn_session_new(
    int32_t comm, const m4gn_mesh_data* mesh, const m4gn_session_options* options, m4gn_session** session)
{
    (void)comm;
    (void)options;
    FILE* file = fopen(variable("ORACLE_FILE", "oracle.bin"), "rb");
    if (!file)
    {
        message = "no recording";
        return M4GN_ERROR_FILE;
    }
    m4gn_session* s = calloc(1, sizeof(*s));
    s->n_cells = mesh->n_cells;
    fseek(file, 0, SEEK_END);
    const size_t bytes = ftell(file);
    rewind(file);
    s->n_frames = bytes/(4*s->n_cells*sizeof(double));
    s->frames = malloc(bytes);
    s->centres = malloc(3*s->n_cells*sizeof(double));
    memcpy(s->centres, mesh->cell_centres, 3*s->n_cells*sizeof(double));
    const size_t got = fread(s->frames, 1, bytes, file);
    fclose(file);
    *session = s;
    return got == bytes ? M4GN_OK : M4GN_ERROR_FILE;
}

void m4gn_session_free(m4gn_session* s)
{
    free(s->frames);
    free(s->centres);
    free(s);
}

double m4gn_session_stride(const m4gn_session* s)
{
    (void)s;
    return atof(variable("ORACLE_STRIDE", "0.05"));
}

int32_t m4gn_session_n_segments(const m4gn_session* s) { (void)s; return 1; }
int32_t m4gn_session_n_fields(const m4gn_session* s) { (void)s; return 2; }

int32_t m4gn_session_field(const m4gn_session* s, int32_t index, m4gn_field_info* info)
{
    (void)s;
    memset(info, 0, sizeof(*info));
    info->name = index ? "p" : "U";
    info->components = index ? 1 : 3;
    info->dimensions[1] = index ? 2 : 1;
    info->dimensions[2] = index ? -2 : -1;
    info->is_input = info->is_output = 1;
    return M4GN_OK;
}

int32_t m4gn_session_segments(const m4gn_session* s, int32_t* cell_segment)
{
    memset(cell_segment, 0, s->n_cells*sizeof(*cell_segment));
    return M4GN_OK;
}

int32_t m4gn_session_step(
    m4gn_session* s, const m4gn_field* in, int32_t n_in, const m4gn_field_out* out, int32_t n_out)
{
    (void)n_in;
    (void)n_out;
    const long ahead = atol(variable("ORACLE_FRAMES", "25"));
    const double error = atof(variable("ORACLE_ERROR", "0"));

    /* The frame that is nearest to the velocity */
    long nearest = 0;
    double least = INFINITY;
    for (long f = 0; f < s->n_frames; ++f)
    {
        const double* U = s->frames + 4*s->n_cells*f;
        double sum = 0;
        for (size_t i = 0; i < 3*s->n_cells; ++i)
        {
            sum += (in[0].cells[i] - U[i])*(in[0].cells[i] - U[i]);
        }
        if (sum < least)
        {
            least = sum;
            nearest = f;
        }
    }
    if (nearest + ahead >= s->n_frames)
    {
        message = "the recording ends before";
        return M4GN_ERROR_NUMERICAL;
    }

    const double* U = s->frames + 4*s->n_cells*(nearest + ahead);
    const double* p = U + 3*s->n_cells;
    for (size_t c = 0; c < s->n_cells; ++c)
    {
        const double x = s->centres[3*c];
        const double y = s->centres[3*c + 1];
        out[0].cells[3*c] = U[3*c] + error*sin(15.7*x)*sin(15.3*y);
        out[0].cells[3*c + 1] = U[3*c + 1] + error*cos(20.9*x)*sin(15.3*y);
        out[1].cells[c] = p[c];
    }
    return M4GN_OK;
}
