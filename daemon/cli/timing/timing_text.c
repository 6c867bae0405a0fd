/* SPDX-License-Identifier: MIT
 *
 * timing_text.c - a bit timing as text and as JSON.
 */
#include "cli/timing/timing_text.h"

#include "base/text/decimal.h"
#include "base/text/jsontext.h"

#include <inttypes.h>

#define PPB_DIGITS 9u
#define PPB_PER_MILLIPERCENT 10000u
#define PPB_PER_CENTIPERCENT 100000u
#define PPB_PER_PERMILLE 1000000u

static decimal_text percent_of_ppb(uint32_t ppb)
{
    return decimal((ppb + PPB_PER_MILLIPERCENT / 2) / PPB_PER_MILLIPERCENT, 3);
}

static decimal_text ns_of_quanta(const bit_timing *t, uint32_t quanta)
{
    return decimal(timing_quanta_ps(t, quanta), 3);
}

/* Prints the error of the bit rate, rounded up so that it never looks like none. */
static void print_bitrate_error(FILE *out, const bit_timing *t, uint32_t wished_bps)
{
    uint64_t wished_hz = timing_bit_clocks(t) * wished_bps;
    bool below = t->clock_hz < wished_hz;
    uint64_t error = below ? wished_hz - t->clock_hz : t->clock_hz - wished_hz;

    if (error > 0)
        fprintf(out, ", %s %% %s %" PRIu32,
                decimal((error * 10000 + wished_hz - 1) / wished_hz, 2).text,
                below ? "below" : "above", wished_bps);
}

/* Prints the bit rate that results, which may differ from the wish. */
static void print_bit(FILE *out, const bit_timing *t, uint32_t wished_bps)
{
    fprintf(out, "bit           %" PRIu32 " tq of %s ns: %" PRIu32 " bit/s", timing_quanta(t),
            ns_of_quanta(t, 1).text, timing_bitrate_bps(t));
    print_bitrate_error(out, t, wished_bps);
    fputc('\n', out);
}

/* prop-seg must cover the round trip, so that is printed with it, if it was given. */
static void print_prop(FILE *out, const bit_timing *t, const timing_request *request)
{
    fprintf(out, "prop-seg      %" PRIu32 " tq, %s ns", t->prop_seg,
            ns_of_quanta(t, t->prop_seg).text);
    if (request->has_round_trip)
        fprintf(out, " for a round trip of %" PRIu64 " ns", request->round_trip_ns);
    fputc('\n', out);
}

/* Prints the sample point, and the wished one when they differ. */
static void print_sample(FILE *out, const bit_timing *t, uint32_t wished_permille)
{
    uint32_t ppb = timing_sample_point_ppb(t);

    fprintf(out, "sample-point  %s %%", decimal(ppb / PPB_PER_CENTIPERCENT, 2).text);
    if (wished_permille > 0 && ppb != wished_permille * PPB_PER_PERMILLE)
        fprintf(out, ", the nearest to %s %%", decimal(wished_permille, 1).text);
    fputc('\n', out);
}

/* Prints how much clocks may differ, and which of the two limits it is. */
static void print_tolerance(FILE *out, const bit_timing *t)
{
    fprintf(out, "tolerance     %s %%: %s %% by sjw, %s %% by the phase segments\n",
            percent_of_ppb(timing_tolerance_ppb(t)).text,
            percent_of_ppb(timing_tolerance_of_sjw_ppb(t)).text,
            percent_of_ppb(timing_tolerance_of_phases_ppb(t)).text);
}

void timing_print_text(FILE *out, const bit_timing *t, const timing_request *request)
{
    print_bit(out, t, request->bitrate_bps);
    fprintf(out, "brp           %" PRIu32 "\n", t->brp);
    print_prop(out, t, request);
    fprintf(out, "phase-seg1    %" PRIu32 " tq\n", t->phase_seg1);
    fprintf(out, "phase-seg2    %" PRIu32 " tq\n", t->phase_seg2);
    fprintf(out, "sjw           %" PRIu32 " tq\n", t->sjw);
    print_sample(out, t, request->sample_permille);
    print_tolerance(out, t);
}

void timing_print_data_text(FILE *out, const bit_timing *nominal, const bit_timing *data,
                            const timing_request *request, const timing_limits *limits)
{
    const uint32_t ppb = timing_sample_point_ppb(data);

    fputs("\ndata phase\n", out);
    print_bit(out, data, request->bitrate_bps);
    fprintf(out,
            "dbrp          %" PRIu32 "\ndprop-seg     %" PRIu32 " tq\ndphase-seg1   %" PRIu32
            " tq\ndphase-seg2   %" PRIu32 " tq\ndsjw          %" PRIu32 " tq\n",
            data->brp, data->prop_seg, data->phase_seg1, data->phase_seg2, data->sjw);
    fprintf(out, "dsample-point %s %%\n", decimal(ppb / PPB_PER_CENTIPERCENT, 2).text);
    fprintf(out,
            "dtolerance    %s %%: %s %% by dsjw, %s %% behind an error, %s %% where the rate "
            "changes\n",
            percent_of_ppb(timing_data_tolerance_ppb(nominal, data)).text,
            percent_of_ppb(timing_tolerance_of_sjw_ppb(data)).text,
            percent_of_ppb(timing_tolerance_of_data_error_ppb(nominal, data)).text,
            percent_of_ppb(timing_tolerance_of_switch_ppb(nominal, data)).text);
    if (data->brp <= TIMING_TDC_BRP_MAX)
        fprintf(out, "tdco          %" PRIu32 " clocks\n", timing_linux_tdco(data, limits));
}

void timing_put_segments(buffer *out, const bit_timing *t, bool data)
{
    static const char *const keys[] = {"dbrp", "dprop-seg", "dphase-seg1", "dphase-seg2", "dsjw"};
    const uint32_t values[] = {t->brp, t->prop_seg, t->phase_seg1, t->phase_seg2, t->sjw};
    for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
        jsontext_number(out, data ? keys[i] : keys[i] + 1, values[i]);
}

void timing_put_fraction(buffer *out, const char *key, int64_t ppb)
{
    jsontext_value(out, key, decimal_signed(ppb, PPB_DIGITS).text);
}

void timing_put_data(buffer *out, const bit_timing *nominal, const bit_timing *data)
{
    timing_put_segments(out, data, true);
    jsontext_value(out, "dtq", ns_of_quanta(data, 1).text);
    timing_put_fraction(out, "dsample-point", timing_sample_point_ppb(data));
    timing_put_fraction(out, "dtolerance", timing_data_tolerance_ppb(nominal, data));
}

void timing_print_json(FILE *out, const bit_timing *t, const bit_timing *data,
                       const timing_limits *limits)
{
    buffer text = {.data = NULL};
    buffer_put(&text, "{");
    timing_put_segments(&text, t, false);
    timing_put_fraction(&text, "sample-point", timing_sample_point_ppb(t));
    timing_put_fraction(&text, "tolerance", timing_tolerance_ppb(t));
    if (data)
        timing_put_data(&text, t, data);
    if (data && data->brp <= TIMING_TDC_BRP_MAX) /* Linux compensates */
        jsontext_number(&text, "tdco", timing_linux_tdco(data, limits));
    buffer_put(&text, "}");
    jsontext_out(&text, out);
}
