// SPDX-License-Identifier: GPL-3.0-or-later
/*
    The C interface of src/averages: series of a run's results, and what is
    known of their means. No function prints, exits or lets an error out other
    than by what it returns. Handles are used by one thread at a time.
*/

#ifndef m4gn_averages_h
#define m4gn_averages_h

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

//- Series, one a quantity
typedef struct m4gn_averages m4gn_averages;

//- What is known of a series. Not finite: not known.
typedef struct
{
    double mean, half_width;
    double rms, rms_half_width;
    //- 1/s; 0: nothing oscillates
    double frequency, frequency_resolution;
    //- s
    double transient_end;
    double independent_samples;
    //- Share of the time after the transient, 0 to 1
    double surrogate_share;
    int64_t rows;
    //- Is what is asked for known, by the last two checks? Not where the value
    //  that came last is not finite.
    int32_t settled;
    //- Have all rows the first value? It may be of what the flow has not reached.
    int32_t unvaried;
} m4gn_averages_figures;

//- No series yet; null if the confidence is not between 0 and 1
m4gn_averages* m4gn_averages_new(double confidence);

void m4gn_averages_free(m4gn_averages* averages);

//- Adds a series. Tolerance: largest half-width, over the figure's magnitude
//  if relative; 0: the figure is told, and never waited for. of_rms: of the
//  rms of the fluctuations, in place of the mean. The name is UTF-8, and so is
//  what its values are of: a series of another source is not carried on.
void m4gn_averages_add(
    m4gn_averages* averages, const char* name, const char* source, double tolerance, int32_t relative,
    int32_t of_rms);

//- Goes on with what others have of series of these names and sources,
//  whatever their tolerances. How many there were.
int32_t m4gn_averages_carry_on(m4gn_averages* averages, const m4gn_averages* before);

//- Adds a row to a series: a value, and the time (s) that it stands for, which
//  ends at time. 0, or 1 if it is refused: not later than the last one, or
//  not finite.
int32_t m4gn_averages_push(
    m4gn_averages* averages, size_t series, double time, double value, double weight, int32_t surrogate);

//- Has the longest series grown by a tenth since the last check?
int32_t m4gn_averages_due(const m4gn_averages* averages);

//- Looks at a series. 0, or 1 if there are too few rows, values whose squares
//  are no numbers, or a last value that is not finite.
int32_t m4gn_averages_check(m4gn_averages* averages, size_t series, m4gn_averages_figures* figures);

//- The last check of a series in words, as many as there is room for
void m4gn_averages_line(const m4gn_averages* averages, size_t series, char* text, size_t size);

//- Writes all series to a file, whole or not at all. 0, or 1 and why not.
int32_t m4gn_averages_save(const m4gn_averages* averages, const char* path, char* why, size_t size);

//- Reads what a file has of series of these names and sources. 0, or 1 and
//  why not, as where it has none of them, or rows later than latest (s): the
//  series are then as they were.
int32_t m4gn_averages_load(m4gn_averages* averages, const char* path, double latest, char* why, size_t size);

#ifdef __cplusplus
}
#endif

#endif
