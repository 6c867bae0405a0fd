/* SPDX-License-Identifier: MIT
 *
 * timing.c - canwire timing: the segments of a bit, from bit rate, clock and delays, or those of a
 *            configuration.
 */
#include "base/options.h"
#include "base/text/nearest.h"
#include "base/text/number.h"
#include "base/text/plain.h"
#include "cli/cli.h"
#include "cli/timing/timing_text.h"
#include "config/config.h"

#include <getopt.h>
#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#define BITRATE_MIN 1000u
#define BITRATE_MAX 20000000u
#define CLOCK_MIN 100000u
#define CLOCK_MAX 1000000000u
#define SJW_MAX 128u
#define DELAY_MAX_NS 100000000u /* 100 ms */
#define LENGTH_MAX_MM 10000000u /* 10 km */
#define LINE_PS_PER_MM 5u       /* 5 ns a metre (T2) */
#define PS_PER_NS 1000u
#define TRANSCEIVER_NS 75u /* transmitter or receiver of a usual transceiver */
#define NAME_LINE_MAX 78   /* columns of the list of controllers */

typedef struct timing_options {
    timing_request request;
    timing_request data; /* bitrate_bps 0: no data phase */
    bool has_delay; /* --delay */
    bool has_line;  /* --length, --tx-delay or --rx-delay */
    uint64_t delay_ns;
    uint64_t length_mm;
    uint64_t tx_ns;
    uint64_t rx_ns;
    bool kernel;
    bool json;
    bool has_numbers; /* an option but --json */
    const char *file; /* a configuration, or NULL */
} timing_options;

static const char usage[] =
    "usage: canwire timing --bitrate N --clock F [--kernel[=VERSION]] [--tq N] [--sample-point P]\n"
    "       [--delay TIME] [--length L] [--tx-delay TIME] [--rx-delay TIME] [--sjw N]\n"
    "       [--controller NAME] [--dbitrate N [--dsample-point P]] [--json]\n"
    "       canwire timing FILE [--json]\n";

static const char help[] =
    "Finds the segments of a bit, so that two nodes at the ends of a line understand each other.\n"
    "A bit has exactly the bit rate, and 8 to 25 time quanta (tq). prop-seg covers the round "
    "trip:\n"
    "2 x (transmitter + line + receiver). The rest, 3 to 16 tq, is halved for phase-seg1 and\n"
    "phase-seg2; if it is odd, phase-seg2 gets more. sjw is min(4, phase-seg1, phase-seg2). With "
    "a\n"
    "sample point, phase-seg2 comes from that, and prop-seg takes what is left.\n"
    "\n"
    "  --bitrate N    in bit/s, 1000 to 20000000\n"
    "  --clock F      of the controller: 16MHz, 8.333MHz, 80000000 (Hz)\n"
    "  --tq N         tq of a bit, 8 to 25; else the best number that the clock can be divided\n"
    "                 into: nearest sample point, then largest tolerance, then most tq\n"
    "  --sample-point P\n"
    "                 the nearest is taken: 87.5% or 0.875; without it and without a delay what\n"
    "                 CiA recommends: 87.5% up to 500 kbit/s, 80% up to 800, else 75%\n"
    "  --delay TIME   the whole round trip, 600ns\n"
    "  --length L     of the line, 40m, with 5 ns a metre; in place of --delay\n"
    "  --tx-delay TIME\n"
    "                 of controller and transceiver, from a bit's start to its edge on the line\n"
    "  --rx-delay TIME\n"
    "                 the same back. Both are 75ns if not given: a usual transceiver has a loop\n"
    "                 delay of 150 ns. Data sheets allow up to 255 ns\n"
    "  --sjw N        in place of the rule's\n"
    "  --controller NAME\n"
    "                 whose limits count, see below; default any\n"
    "  --kernel[=VERSION]\n"
    "                 as Linux does it for ip link set can0 type can bitrate N: a bit rate within\n"
    "                 5 %, then the sample point; delays do not count. VERSION is 4.8 or later;\n"
    "                 before 6.3 sjw was 1, before 5.19 brp was large where others are as good\n"
    "  --dbitrate N   bit rate of the data phase of CAN FD, at least the other one. Both phases\n"
    "                 are then found as in a configuration, with one brp where that gives both\n"
    "                 rates and sample points. With --tq or a delay the data phase takes the\n"
    "                 other's brp where that gives the rate; with --kernel each is found alone\n"
    "  --dsample-point P\n"
    "                 as --sample-point, in the data phase\n"
    "  --json         as JSON: segments in tq, sample point and tolerance as fractions; with FILE\n"
    "                 tq and round trip in ns, lines in m, errors of clock and bit rate in ppm\n"
    "  -h, --help     this text\n"
    "\n"
    "tolerance is how far the clock of each node may be off, the smaller of sjw / (20 bits) and\n"
    "min(phase-seg1, phase-seg2) / (2 (13 bits - phase-seg2)). dtolerance is the smallest of\n"
    "dsjw / (20 dbits), of min(phase-seg1, phase-seg2) / (2 ((6 dbits - dphase-seg2) dbrp / brp\n"
    "+ 7 bits)), and of (dsjw - max(0, brp / dbrp - 1)) / (2 ((2 bits - phase-seg2) brp / dbrp +\n"
    "dphase-seg2 + 4 dbits)). tdco is that of Linux, with a dbrp of 1 or 2.\n"
    "\n"
    "With FILE, a configuration, it shows all nodes: tq, segments and sjw, prescaler, sample "
    "point\n"
    "and its distance from that of the bus, and the errors of the clock and, by the prescaler, of\n"
    "the bit rate. LEFT is what the node with the most different clock leaves of the tolerance, "
    "and\n"
    "SURE is the same with a phase-seg2 that is 1 tq shorter. LINE is the longest line to the "
    "node\n"
    "that is nearest to its limit. RESYNCS counts the edges of the longest frame, ten bits apart,\n"
    "that are off by 1 tq or more.\n"
    "\n"
    "Exit status: 0, 1 a value is bad or no segments are possible, 2 wrong usage.\n"
    "\n";

/* ---- Values ---------------------------------------------------------------------------------- */

/* Complains about a value. */
static bool refuse_value(const char *option, const char *text, const char *allowed)
{
    plain_print(stderr, "canwire timing: %s %s: %s\n", option, text, allowed);
    return false;
}

/* Takes a whole number. One that is meant in another way of writing gets a hint. */
static bool take_number(uint32_t *out, const char *option, const char *text, uint32_t lowest,
                        uint32_t highest)
{
    char allowed[80];
    uint64_t value;

    if (!text_parse_uint(&value, text) && value >= lowest && value <= highest) {
        *out = (uint32_t)value;
        return true;
    }
    int used = snprintf(allowed, sizeof allowed,
                        "expected a whole number from %" PRIu32 " to %" PRIu32, lowest, highest);
    if (text_meant_uint(&value, text) && value >= lowest && value <= highest)
        snprintf(allowed + used, sizeof allowed - (size_t)used, ", write %" PRIu64, value);
    return refuse_value(option, text, allowed);
}

static bool take_bitrate(void *out, const char *option, const char *text)
{
    return take_number(out, option, text, BITRATE_MIN, BITRATE_MAX);
}

static bool take_quanta(void *out, const char *option, const char *text)
{
    return take_number(out, option, text, TIMING_QUANTA_MIN, TIMING_QUANTA_MAX);
}

static bool take_sjw(void *out, const char *option, const char *text)
{
    return take_number(out, option, text, 1, SJW_MAX);
}

/* The clock is that of the controller, in Hz, as data sheets have it. */
static bool take_clock(void *out, const char *option, const char *text)
{
    uint64_t hz;
    const char *wrong = text_parse_frequency(&hz, text);

    if (wrong)
        return refuse_value(option, text, wrong);
    if (hz < CLOCK_MIN || hz > CLOCK_MAX)
        return refuse_value(option, text, "expected 100kHz to 1GHz");
    *(uint32_t *)out = (uint32_t)hz;
    return true;
}

/* Takes the wanted sample point as permille of the bit. */
static bool take_sample(void *out, const char *option, const char *text)
{
    uint16_t permille;
    const char *wrong = text_parse_sample_point(&permille, text);

    if (wrong)
        return refuse_value(option, text, wrong);
    *(uint32_t *)out = permille;
    return true;
}

/* Takes a delay in ns. Bits are refused: their length is yet to be found. */
static bool take_delay(void *out, const char *option, const char *text)
{
    cfg_time time;
    const char *wrong = text_parse_time(&time, text);

    if (wrong)
        return refuse_value(option, text, wrong);
    if (time.bits > 0 || time.ns > DELAY_MAX_NS)
        return refuse_value(option, text, "expected a time such as 600ns, up to 100ms");
    *(uint64_t *)out = time.ns;
    return true;
}

/* Takes the length of the line in mm. */
static bool take_length(void *out, const char *option, const char *text)
{
    uint64_t *mm = out;
    const char *wrong = text_parse_length(mm, text);

    if (wrong)
        return refuse_value(option, text, wrong);
    return *mm <= LENGTH_MAX_MM || refuse_value(option, text, "expected up to 10km");
}

/* Takes the name of a controller, with a guess for one that is not known. */
static bool take_controller(void *out, const char *option, const char *text)
{
    const timing_limits **limits = out;
    nearest guess = {.word = text};
    size_t count;
    const timing_limits *all = timing_controllers(&count);

    *limits = timing_controller(text);
    if (*limits)
        return true;
    for (size_t i = 0; i < count; i++)
        nearest_consider(&guess, all[i].name);
    plain_print(stderr, "canwire timing: %s %s: expected a name as in --help%s%s\n", option, text,
                guess.best ? ", did you mean " : "", guess.best ? guess.best : "");
    return false;
}

/* Reads 5.10 as 510. */
static bool take_version(void *out, const char *option, const char *text)
{
    unsigned major = 0, minor = 0;
    int end = 0;

    if (strspn(text, "0123456789.") == strlen(text) &&
        sscanf(text, "%2u.%2u%n", &major, &minor, &end) == 2 && text[end] == '\0' &&
        major * 100 + minor >= TIMING_LINUX_MIN) {
        *(uint32_t *)out = major * 100 + minor;
        return true;
    }
    return refuse_value(option, text, "expected a version such as 6.12, 4.8 or later");
}

/* ---- Command line ---------------------------------------------------------------------------- */

/* Lists the controllers, in lines of a paragraph. */
static void print_controllers(FILE *out)
{
    size_t count;
    const timing_limits *all = timing_controllers(&count);
    size_t column = (size_t)fprintf(out, "Controllers:");

    for (size_t i = 0; i < count; i++) {
        size_t width = 1 + strlen(all[i].name);
        if (column + width > NAME_LINE_MAX) {
            fputc('\n', out);
            column = 0;
        }
        column += (size_t)fprintf(out, "%s%s", column > 0 ? " " : "", all[i].name);
    }
    fputc('\n', out);
}

/* Complains; returns the exit status. */
static int timing_refuse(const char *what, const char *why)
{
    plain_print(stderr, "canwire timing: %s: %s\n%s", what, why, usage);
    return CLI_USAGE;
}

/* Checks combinations of options. Returns -1 to go on, otherwise the exit status. */
static int check_options(const timing_options *o, const char *word)
{
    if (word)
        return timing_refuse(word,
                             "FILE stands alone, or with --json; else only options are taken");
    if (o->request.bitrate_bps == 0 || o->request.clock_hz == 0)
        return timing_refuse("--bitrate and --clock", "both are needed");
    if (o->has_delay && o->has_line)
        return timing_refuse("--delay",
                             "it is the whole round trip, without --length, --tx-delay and "
                             "--rx-delay");
    if (o->data.sample_permille > 0 && o->data.bitrate_bps == 0)
        return timing_refuse("--dsample-point", "it needs --dbitrate");
    if (o->kernel && (o->request.quanta > 0 || o->has_delay || o->has_line))
        return timing_refuse("--kernel", "Linux knows no --tq and no delays");
    return -1;
}

/* Returns -1 to go on, otherwise the exit status. */
static int timing_parse_options(timing_options *o, int argc, char **argv)
{
    timing_request *r = &o->request;
    bool *any = &o->has_numbers;
    const option_row rows[] = {
        {"bitrate", .read = take_bitrate, .out = &r->bitrate_bps, .flag = any},
        {"clock", .read = take_clock, .out = &r->clock_hz, .flag = any},
        {"tq", .read = take_quanta, .out = &r->quanta, .flag = any},
        {"sample-point", .read = take_sample, .out = &r->sample_permille, .flag = any},
        {"sjw", .read = take_sjw, .out = &r->sjw, .flag = any},
        {"controller", .read = take_controller, .out = &r->limits, .flag = any},
        {"dbitrate", .read = take_bitrate, .out = &o->data.bitrate_bps, .flag = any},
        {"dsample-point", .read = take_sample, .out = &o->data.sample_permille, .flag = any},
        {"kernel", .read = take_version, .out = &r->linux_version, .flag = &o->kernel,
         .may_lack = true},
        {"delay", .read = take_delay, .out = &o->delay_ns, .flag = &o->has_delay},
        {"length", .read = take_length, .out = &o->length_mm, .flag = &o->has_line},
        {"tx-delay", .read = take_delay, .out = &o->tx_ns, .flag = &o->has_line},
        {"rx-delay", .read = take_delay, .out = &o->rx_ns, .flag = &o->has_line},
        {"json", .flag = &o->json},
        {.name = NULL},
    };
    const option_table table = {
        .usage = usage, .help = help, .more = print_controllers, .rows = rows};
    const int status = options_read(&table, argc, argv);

    if (status >= 0)
        return status;
    o->has_numbers = o->has_numbers || o->kernel || o->has_delay || o->has_line;
    if (!o->has_numbers && optind == argc - 1) {
        o->file = argv[optind];
        return -1;
    }
    return check_options(o, optind < argc ? argv[optind] : NULL);
}

/* Shows the nodes of a configuration. */
static int show_file(const timing_options *o)
{
    cfg *config = cfg_load(o->file, stderr);

    if (!config)
        return CLI_BAD_INPUT;
    fputs(config->warnings, stderr);
    if (o->json)
        timing_table_print_json(stdout, config);
    else
        timing_table_print(stdout, config);
    cfg_free(config);
    return CLI_OK;
}

/* Returns 2 x (transmitter + line + receiver), rounded up (T10). */
static uint64_t round_trip_ns(const timing_options *o)
{
    uint64_t line_ps = 2 * o->length_mm * LINE_PS_PER_MM;

    if (o->has_delay)
        return o->delay_ns;
    return 2 * (o->tx_ns + o->rx_ns) + (line_ps + PS_PER_NS - 1) / PS_PER_NS;
}

/* ---- Results --------------------------------------------------------------------------------- */

static bool find_one(bit_timing *out, char problem[TIMING_PROBLEM_MAX], const timing_options *o)
{
    return o->kernel ? timing_by_kernel(out, problem, &o->request)
                     : timing_by_segments(out, problem, &o->request);
}

/* Completes what is wanted of the data phase. Returns false after a message. */
static bool want_data(timing_options *o)
{
    const timing_request *r = &o->request;

    o->data.limits = timing_data_limits(r->limits);
    o->data.clock_hz = r->clock_hz;
    o->data.linux_version = r->linux_version;
    if (!o->data.limits)
        plain_print(stderr, "canwire timing: --controller %s knows no CAN FD frames\n",
                    r->limits->name);
    else if (o->data.bitrate_bps < r->bitrate_bps)
        plain_print(stderr, "canwire timing: --dbitrate %" PRIu32 ": the data phase is not slower "
                    "than --bitrate, %" PRIu32 "\n", o->data.bitrate_bps, r->bitrate_bps);
    return o->data.limits && o->data.bitrate_bps >= r->bitrate_bps;
}

/* Finds both phases. */
static bool find_both(bit_timing found[2], char problem[TIMING_PROBLEM_MAX],
                      const timing_options *o)
{
    const bool by_segments = o->request.quanta > 0 || o->request.has_round_trip;

    if (!o->kernel && !by_segments)
        return timing_by_rates(&found[0], &found[1], problem, &o->request, &o->data);
    if (!find_one(&found[0], problem, o))
        return false;
    return by_segments ? timing_data_beside(&found[1], problem, &found[0], &o->data)
                       : timing_by_kernel(&found[1], problem, &o->data);
}

static void timing_show(const timing_options *o, const bit_timing found[2])
{
    const timing_limits *limits = o->request.limits;
    const bool has_data = o->data.bitrate_bps > 0;

    if (o->json) {
        timing_print_json(stdout, &found[0], has_data ? &found[1] : NULL, limits);
        return;
    }
    timing_print_text(stdout, &found[0], &o->request);
    if (has_data)
        timing_print_data_text(stdout, &found[0], &found[1], &o->data, limits);
}

int cli_timing(int argc, char **argv)
{
    timing_options o = {.request = {.limits = timing_controller("any")},
                        .tx_ns = TRANSCEIVER_NS,
                        .rx_ns = TRANSCEIVER_NS};
    char problem[TIMING_PROBLEM_MAX];
    bit_timing found[2];
    int status = timing_parse_options(&o, argc, argv);

    if (status >= 0)
        return status;
    if (o.file)
        return show_file(&o);
    o.request.has_round_trip = o.has_delay || o.has_line;
    if (o.request.has_round_trip)
        o.request.round_trip_ns = round_trip_ns(&o);
    const bool has_data = o.data.bitrate_bps > 0;
    if (has_data && !want_data(&o))
        return CLI_BAD_INPUT;
    if (has_data ? !find_both(found, problem, &o) : !find_one(&found[0], problem, &o)) {
        plain_print(stderr, "canwire timing: %s\n", problem);
        return CLI_BAD_INPUT;
    }
    timing_show(&o, found);
    return CLI_OK;
}
