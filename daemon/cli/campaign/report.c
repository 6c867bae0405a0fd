/* SPDX-License-Identifier: MIT
 *
 * report.c - `canwire campaign report`: what the rows of a campaign show together.
 */
#include "base/options.h"
#include "base/text/plain.h"
#include "campaign/pool.h"
#include "campaign/report/intake.h"
#include "campaign/report/memory.h"
#include "cli/campaign/parts.h"
#include "cli/campaign/report_view.h"
#include "cli/campaign/rowfile.h"
#include "cli/cli.h"

#include <errno.h>
#include <getopt.h>
#include <libgen.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#define CONFIDENCE 0.95
#define MINIMISE_NS UINT64_C(60000000000)
#define MINIMISE_NS_MAX UINT64_C(86400000000000)
#define FOLDER_MODE 0777 /* less the umask */

const char campaign_report_usage[] =
    "       canwire campaign report F... [--campaign FILE] [--partial] [--ftti TIME]\n"
    "       [--confidence P] [--json F] [--html F] [--junit F] [--scenarios DIR]\n"
    "       [--minimise TIME] [--jobs J]\n";

const char campaign_report_help[] =
    "`report` reads rows of `canwire campaign run` or `canwire sim --seeds`: classes with\n"
    "confidence intervals, coverage, and detection latency. Several files are parts of one\n"
    "campaign. \"-\" is standard input.\n"
    "\n"
    "  --campaign FILE  the campaign of the rows; by default the one that they name\n"
    "  --partial        some rows may be missing; the report says so\n"
    "  --ftti TIME      the limit of detection latencies, such as 50ms; by default `ftti` of the\n"
    "                   campaign\n"
    "  --confidence P   of the intervals, such as 99%; default 95%\n"
    "  --json F         write the report as JSON, too; \"-\": to standard output, in place of the\n"
    "                   text\n"
    "  --html F         write it as a page with plots, in the same way\n"
    "  --junit F        write it as JUnit XML, with a case for each class and each value\n"
    "  --scenarios DIR  make the shortest scenarios of each class of failures, and write them\n"
    "                   into this folder, and into the other outputs\n"
    "  --minimise TIME  spend so much real time on them, at most; default 60s\n"
    "  --jobs J         read large files in so many processes, by default one a processor\n";

typedef struct options {
    const char *campaign;
    const char *json;
    const char *html;
    const char *junit;
    const char *scenarios; /* a folder; NULL: none are made */
    uint64_t minimise_ns;
    bool partial;
    uint64_t ftti_ns; /* 0: that of the campaign */
    double confidence;
    unsigned jobs;
} options;

/* ---- Files ----------------------------------------------------------------------------------- */

#define REPORT_OUTPUTS 3u

/* Options that write a file. "-" is standard output, NULL none. */
typedef struct report_outputs {
    const char *option[REPORT_OUTPUTS]; /* such as "--json" */
    const char *name[REPORT_OUTPUTS];
} report_outputs;

#define STANDARD_INPUT "/proc/self/fd/0"

static bool is_dash(const char *name)
{
    return strcmp(name, "-") == 0;
}

/* Returns the one name that a file has, which need not be there yet, to be freed. */
static char *real_name(const char *name)
{
    char *real = realpath(name, NULL);
    if (real)
        return real;
    char *first = memory_text(name);
    char *second = memory_text(name);
    char *folder = realpath(dirname(first), NULL);
    char *result = memory_print("%s/%s", folder ? folder : "", basename(second));
    free(folder);
    free(first);
    free(second);
    return result;
}

/* Returns true when two names lead to one file, which need not exist yet. */
static bool report_files_is_same(const char *a, const char *b)
{
    char *first = real_name(a);
    char *second = real_name(b);
    const bool same = strcmp(first, second) == 0;
    free(first);
    free(second);
    return same;
}

static bool are_one_output(const char *a, const char *b)
{
    if (is_dash(a) || is_dash(b))
        return is_dash(a) && is_dash(b);
    return report_files_is_same(a, b);
}

/* Returns true when all outputs are different files. False: after a message. */
static bool report_outputs_differ(const report_outputs *out)
{
    for (size_t i = 0; i < REPORT_OUTPUTS; i++) {
        for (size_t k = i + 1; k < REPORT_OUTPUTS; k++) {
            if (!out->name[i] || !out->name[k] || !are_one_output(out->name[i], out->name[k]))
                continue;
            plain_print(stderr, "canwire campaign: %s %s: it is the file of %s, too; give each its "
                        "own\n", out->option[k], out->name[k], out->option[i]);
            return false;
        }
    }
    return true;
}

/* Returns true when no output is this source; "-" is standard input, NULL none. False: after a
 * message. */
static bool report_outputs_spare(const report_outputs *out, const char *source)
{
    for (size_t i = 0; i < REPORT_OUTPUTS && source; i++) {
        const char *from = is_dash(source) ? STANDARD_INPUT : source;
        if (!out->name[i] || is_dash(out->name[i]) || !report_files_is_same(out->name[i], from))
            continue;
        plain_print(stderr, "canwire campaign: %s %s: the report reads this file, and does not "
                    "overwrite it\n", out->option[i], out->name[i]);
        return false;
    }
    return true;
}

/* ---- Options --------------------------------------------------------------------------------- */

bool campaign_complain(const char *option, const char *text, const char *expected)
{
    plain_print(stderr, "canwire campaign: %s %s: expected %s\n", option, text, expected);
    return false;
}

bool campaign_take_jobs(void *out, const char *option, const char *text)
{
    uint64_t number = 0;
    if (text_parse_uint(&number, text) || number < 1 || number > POOL_JOBS_MAX)
        return campaign_complain(option, text, "a whole number from 1 to 256");
    *(unsigned *)out = (unsigned)number;
    return true;
}

/* Takes the limit of latencies. Bit times are refused: rows may differ in their bit rate. */
static bool take_ftti(void *out, const char *option, const char *text)
{
    cfg_time time = {.ns = 0};
    if (text_parse_time(&time, text) || time.bits > 0 || time.ns == 0)
        return campaign_complain(option, text, "a time such as 50ms, in units of seconds");
    *(uint64_t *)out = time.ns;
    return true;
}

/* Takes the confidence of intervals. 100 % would make them say nothing. */
static bool take_confidence(void *out, const char *option, const char *text)
{
    char *end = NULL;
    const double percent = strtod(text, &end);
    if (end == text || strcmp(end, "%") != 0 || !(percent >= 50 && percent <= 99.9999))
        return campaign_complain(option, text, "50% to 99.9999%");
    *(double *)out = percent / 100;
    return true;
}

/* Takes the time that looking for shorter scenarios may need; 0: as they are. */
static bool take_minimise(void *out, const char *option, const char *text)
{
    cfg_time time = {.ns = 0};
    if (text_parse_time(&time, text) || time.bits > 0 || time.ns > MINIMISE_NS_MAX)
        return campaign_complain(option, text, "a time such as 60s, up to 24h");
    *(uint64_t *)out = time.ns;
    return true;
}

/* Returns -1 to go on, otherwise the exit status. */
static int report_parse_options(options *o, int argc, char **argv)
{
    const option_row rows[] = {
        {"campaign", .text = &o->campaign},
        {"partial", .flag = &o->partial},
        {"ftti", .read = take_ftti, .out = &o->ftti_ns},
        {"confidence", .read = take_confidence, .out = &o->confidence},
        {"json", .text = &o->json},
        {"html", .text = &o->html},
        {"junit", .text = &o->junit},
        {"scenarios", .text = &o->scenarios},
        {"minimise", .read = take_minimise, .out = &o->minimise_ns},
        {"jobs", .read = campaign_take_jobs, .out = &o->jobs},
        {.name = NULL},
    };
    char usage[sizeof campaign_report_usage];
    (void)snprintf(usage, sizeof usage, "usage: %s",
                   campaign_report_usage + strlen("       "));
    const option_table table = {.usage = usage, .help = campaign_report_help, .rows = rows};
    const int status = options_read(&table, argc, argv);
    return status < 0 && optind == argc ? options_refuse(&table) : status;
}

/* ---- Outputs --------------------------------------------------------------------------------- */

static bool is_stdout(const char *name)
{
    return name && strcmp(name, "-") == 0;
}

typedef void report_writer(FILE *out, const report_view *v);

/* Opens the outputs before the work, which would be in vain without them. Each is there as a whole
 * in the end, or not at all. */
static bool open_outputs(rowfile files[REPORT_OUTPUTS], const report_outputs *out)
{
    bool good = true;
    for (size_t i = 0; i < REPORT_OUTPUTS && good; i++)
        good = !out->name[i] || rowfile_open(&files[i], is_stdout(out->name[i]) ? NULL
                                                                                : out->name[i],
                                             false, NULL, NULL);
    return good;
}

/* Closes what has been opened. done: the report is in the files. */
static bool close_outputs(rowfile files[REPORT_OUTPUTS], bool done)
{
    bool good = done;
    for (size_t i = 0; i < REPORT_OUTPUTS; i++)
        good = rowfile_close(&files[i], good) && good;
    return good;
}

/* Makes the folder, unless it exists. Returns false after a message. */
static bool make_folder(const char *name)
{
    if (mkdir(name, FOLDER_MODE) == 0 || errno == EEXIST)
        return true;
    plain_print(stderr, "canwire campaign: %s: %s\n", name, strerror(errno));
    return false;
}

/* Writes a text into a file of the folder. */
static bool report_write_text(const char *folder, const char *name, const char *text)
{
    rowfile file;
    char *path = memory_print("%s/%s", folder, name);
    const bool good = rowfile_open(&file, path, false, NULL, NULL);
    if (good)
        fputs(text, file.stream);
    const bool closed = rowfile_close(&file, good);
    free(path);
    return closed && good;
}

/* A rig and its buses have a folder of their own. */
static bool write_buses(const bundle_text *t, const char *folder, const char *name)
{
    char *inner = memory_print("%s/%.*s", folder, (int)(strchr(name, '/') - name), name);
    bool good = make_folder(inner);
    for (size_t i = 0; i < t->count && good; i++)
        good = report_write_text(inner, t->buses[i].name, t->buses[i].text);
    free(inner);
    return good;
}

/* Writes a scenario into the folder; the buses of a rig get files beside it. */
static bool report_write_scenario(const report_view *v, size_t i, const char *folder)
{
    const bundle_text *buses = &v->shortest->list[i].found.text;
    char *name = report_scenario_name(v->shortest, i);
    char *text = report_scenario_text(v->report, v->shortest, i);
    const bool good = (buses->count == 0 || write_buses(buses, folder, name)) &&
                      report_write_text(folder, name, text);
    free(name);
    free(text);
    return good;
}

/* Writes the shortest scenarios, if any were looked for, up to the first that cannot be written. */
static bool write_scenarios(const report_view *v, const char *folder)
{
    bool good = true;
    for (size_t i = 0; v->shortest && i < v->shortest->count && good; i++)
        good = report_write_scenario(v, i, folder);
    return good;
}

static report_outputs outputs_of(const options *o)
{
    return (report_outputs){.option = {"--json", "--html", "--junit"},
                            .name = {o->json, o->html, o->junit}};
}

/* Returns false after a message when a file has two uses. */
static bool check_outputs(const options *o, char **files, int count)
{
    const report_outputs out = outputs_of(o);
    bool good = report_outputs_differ(&out) && report_outputs_spare(&out, o->campaign);
    for (int i = 0; i < count && good; i++)
        good = report_outputs_spare(&out, files[i]);
    return good;
}

/* The rows name more files. */
static bool check_sources(const options *o, const intake *in)
{
    const report_outputs out = outputs_of(o);
    return report_outputs_spare(&out, in->report.source.file) &&
           report_outputs_spare(&out, in->campaign ? in->campaign->scenario_name : NULL);
}

/* Returns false after a message when standard output has not taken all: a full disk or a closed
 * pipe. */
static bool flush_output(void)
{
    if (fflush(stdout) == 0 && !ferror(stdout))
        return true;
    plain_print(stderr, "canwire campaign: standard output: %s\n", strerror(errno));
    return false;
}

/* Writes all that was asked for. The text goes to standard output, unless another form goes
 * there. */
static bool write_all(const report_view *v, const options *o, const rowfile files[REPORT_OUTPUTS])
{
    static report_writer *const writers[REPORT_OUTPUTS] = {
        campaign_report_json, campaign_report_html, campaign_report_junit};
    if (!is_stdout(o->json) && !is_stdout(o->html) && !is_stdout(o->junit))
        campaign_report_text(stdout, v);
    for (size_t i = 0; i < REPORT_OUTPUTS; i++)
        if (files[i].stream)
            writers[i](files[i].stream, v);
    return write_scenarios(v, o->scenarios) && flush_output();
}

/* ---- The report ------------------------------------------------------------------------------ */

/* Reads all files. */
static bool read_files(intake *in, char **files, int count)
{
    bool good = true;
    for (int i = 0; i < count && good; i++)
        good = intake_read(in, files[i]);
    return good && intake_end(in);
}

/* Without its programs a scenario does something else. */
static bool can_have_scenarios(const intake *in, const options *o)
{
    if (!o->scenarios || !in->campaign || in->campaign->ecus.count == 0)
        return true;
    plain_print(stderr,
                "canwire campaign: --scenarios: the rows of %s are those of programs, which no "
                "scenario alone repeats; the command in 'replay' does\n",
                in->campaign->file);
    return false;
}

/* Finds the shortest scenarios, where they are wanted, and writes the report. */
static bool write_report(const intake *in, const options *o, const rowfile files[REPORT_OUTPUTS])
{
    shortest found = {.count = 0};
    const report_view view = {.report = &in->report, .confidence = o->confidence,
                              .shortest = o->scenarios ? &found : NULL};
    if (o->scenarios)
        shortest_find(&found, &in->report, (int64_t)o->minimise_ns);
    const bool good = write_all(&view, o, files);
    shortest_free(&found);
    return good;
}

int campaign_report(int argc, char **argv)
{
    options o = {.confidence = CONFIDENCE, .minimise_ns = MINIMISE_NS};
    const int status = report_parse_options(&o, argc, argv);
    if (status >= 0)
        return status;
    intake in = {.campaign_file = o.campaign, .partial = o.partial, .ftti_ns = o.ftti_ns,
                 .jobs = o.jobs > 0 ? o.jobs : pool_jobs_default()};
    char **files = argv + optind;
    const int count = argc - optind;
    rowfile outputs[REPORT_OUTPUTS] = {{.name = NULL}};
    const report_outputs wanted = outputs_of(&o);
    bool good = check_outputs(&o, files, count) && open_outputs(outputs, &wanted) &&
                (!o.scenarios || make_folder(o.scenarios)) && read_files(&in, files, count) &&
                check_sources(&o, &in) && can_have_scenarios(&in, &o) &&
                write_report(&in, &o, outputs);
    good = close_outputs(outputs, good);
    intake_free(&in);
    return good ? CLI_OK : CLI_BAD_INPUT;
}
