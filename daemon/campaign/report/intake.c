/* SPDX-License-Identifier: MIT
 *
 * intake.c - reads files of rows into a report, and refuses rows that do not belong together.
 */
#include "campaign/report/intake.h"

#include "base/text/plain.h"
#include "campaign/report/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static bool intake_complain(const intake *in, const char *format, ...)
    __attribute__((format(printf, 2, 3)));

/* Complains about the line. */
static bool intake_complain(const intake *in, const char *format, ...)
{
    va_list args;
    char *text = NULL;
    va_start(args, format);
    const int length = vasprintf(&text, format, args);
    va_end(args);
    plain_print(stderr, "%s:%" PRIu64 ": %s\n", in->file, in->line,
                length < 0 ? "out of memory" : text);
    free(text);
    return false;
}

/* ---- The first row --------------------------------------------------------------------------- */

static bool load_campaign(intake *in, const char *file)
{
    in->campaign = campaign_load(file, stderr);
    in->runner = in->campaign ? runner_new(in->campaign, false) : NULL;
    if (in->campaign)
        in->report.signs = (row_signs){.names = in->campaign->detected,
                                       .count = in->campaign->detected_count};
    return in->runner;
}

/* Returns 0, or the errno with which a file cannot be opened. */
static int error_of(const char *file)
{
    const int fd = open(file, O_RDONLY | O_CLOEXEC);
    if (fd < 0)
        return errno;
    (void)close(fd);
    return 0;
}

/* Finds the campaign of the rows. Without its file the report says what it lacks. */
static bool find_campaign(intake *in)
{
    const char *file = in->report.source.file;
    if (in->campaign_file)
        return in->report.source.is_campaign
                   ? load_campaign(in, in->campaign_file)
                   : intake_complain(in, "it is a row of canwire sim, which has no --campaign");
    in->report.unread = error_of(file);
    if (!in->report.source.is_campaign || in->report.unread != 0)
        return true;
    return load_campaign(in, file);
}

static void set_limit(intake *in)
{
    latency *l = &in->report.latency;
    l->limit_ns = in->ftti_ns == 0 && in->campaign ? in->campaign->ftti_ns : in->ftti_ns;
    l->has_limit = l->limit_ns > 0;
}

static bool intake_begin(intake *in, const char *line, size_t length)
{
    report_row row;
    const char *wrong = report_row_read(&row, &in->reader, line, length, &in->report.signs);
    if (wrong)
        return intake_complain(in, "%s", wrong);
    const bool known = row_source_read(&in->report.source, &row);
    const bool good =
        known ? find_campaign(in)
              : intake_complain(in, "its `repeat` is no command that canwire has written");
    if (good)
        report_begin(&in->report, &row, in->campaign);
    set_limit(in);
    return good;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Returns true when a row begins as the campaign says, perhaps with other blanks. */
static bool has_values(const report_row *row, const buffer *head)
{
    static const char end[] = ",\"outcome\":\"";
    const size_t length = buffer_length(head) - strlen(end);
    jsonread reader = {.copy = NULL};
    jsonread_problem problem;
    char *text = memory_print("%.*s}", (int)length, buffer_first(head));
    const jsonread_value *wanted = memory_json(&reader, &problem, text, length + 1);
    const bool same = jsonread_equals(jsonread_get(wanted, "factors"), row->factors) &&
                      jsonread_equals(jsonread_get(wanted, "seed"),
                                      jsonread_get(row->object, "seed"));
    jsonread_free(&reader);
    free(text);
    return same;
}

static bool check_values(intake *in, const report_row *row, const char *line, size_t length)
{
    const campaign *c = in->campaign;
    if (row->number >= c->rows)
        return intake_complain(in, "%s has no row %" PRIu64 ", its last one is %" PRIu64, c->file,
                               row->number, c->rows - 1);
    buffer head = {.data = NULL};
    runner_head(in->runner, row->number, &head);
    const char *wanted = memory_seen(&head);
    const size_t size = buffer_length(&head);
    const bool same = (length > size && memcmp(line, wanted, size) == 0) ||
                      has_values(row, &head);
    buffer_free(&head);
    return same ||
           intake_complain(in,
                           "row %" PRIu64 " has other values than %s says; is it of another "
                           "campaign, or has the file changed?",
                           row->number, c->file);
}

/* Without the campaign, the names of the factors must be those of the first row. */
static bool check_names(intake *in, const report_row *row)
{
    const report *r = &in->report;
    size_t count = 0;
    const jsonread_value *f = jsonread_first(row->factors);
    for (; f; f = jsonread_next(row->factors, f))
        count++;
    bool same = count == r->factor_count;
    for (size_t i = 0; i < r->factor_count && same; i++)
        same = jsonread_get(row->factors, r->factors[i].name) != NULL;
    return same ||
           intake_complain(in, "its factors are not those of the first row: it is of another "
                               "campaign");
}

static const char *last_part(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

/* Parts may have been made in other folders, where the campaign has the same name. */
static bool is_of_another(const intake *in, const row_source *own)
{
    const row_source *first = &in->report.source;
    if (own->is_campaign != first->is_campaign)
        return true;
    if (!own->is_campaign)
        return !row_source_equals(own, first);
    return !in->campaign_file && strcmp(last_part(own->file), last_part(first->file)) != 0;
}

static bool check_command(intake *in, const report_row *row)
{
    row_source own;
    const row_source *first = &in->report.source;
    bool good = row_source_read(&own, row);
    if (!good)
        (void)intake_complain(in, "its `repeat` is no command that canwire has written");
    else if (is_of_another(in, &own))
        good =
            intake_complain(in, "it is of %s, and the first row is of %s", own.file, first->file);
    row_source_free(&own);
    return good;
}

static bool check(intake *in, const report_row *row, const char *line, size_t length)
{
    if (!check_command(in, row))
        return false;
    if (in->report.source.is_campaign &&
        !(in->campaign ? check_values(in, row, line, length) : check_names(in, row)))
        return false;
    const uint64_t number = row->has_number ? row->number : row->seed;
    return spans_add(&in->report.numbers, number) ||
           intake_complain(in, "%s %" PRIu64 " is there twice", row->has_number ? "row" : "seed",
                           number);
}

static bool intake_take_line(intake *in, const char *line, size_t length)
{
    report_row row;
    if (!in->report.source.file && !intake_begin(in, line, length))
        return false;
    const char *wrong = report_row_read(&row, &in->reader, line, length, &in->report.signs);
    if (wrong)
        return intake_complain(in, "%s", wrong);
    const bool good = check(in, &row, line, length);
    if (good)
        report_add(&in->report, &row);
    return good;
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* A line without its end is that of a run that was ended. */
static bool is_cut(const intake *in, const char *line, size_t length)
{
    if (line[length - 1] == '\n')
        return false;
    if (!in->partial)
        (void)intake_complain(
            in, "the line is cut; `canwire campaign run --resume` completes the file, "
                "--partial passes over it");
    return true;
}

static bool read_lines(intake *in, FILE *stream)
{
    char *line = NULL;
    size_t room = 0;
    bool good = true;
    errno = 0;
    for (ssize_t length; good && (length = getline(&line, &room, stream)) > 0;) {
        in->line++;
        if (is_cut(in, line, (size_t)length)) {
            good = in->partial;
            break;
        }
        good = intake_take_line(in, line, (size_t)length);
    }
    if (good && ferror(stream))
        good = intake_complain(in, "%s", strerror(errno));
    free(line);
    return good;
}

bool intake_read(intake *in, const char *file)
{
    const bool is_stdin = strcmp(file, "-") == 0;
    FILE *stream = is_stdin ? stdin : fopen(file, "re");
    in->file = is_stdin ? "standard input" : file;
    in->line = 0;
    if (!stream) {
        plain_print(stderr, "canwire campaign: %s: %s\n", file, strerror(errno));
        return false;
    }
    const bool good = read_lines(in, stream);
    if (!is_stdin)
        (void)fclose(stream);
    return good;
}

bool intake_end(intake *in)
{
    span gap;
    if (in->report.rows == 0) {
        fputs("canwire campaign: there are no rows\n", stderr);
        return false;
    }
    if (in->partial || !report_missing(&in->report, &gap))
        return true;
    plain_print(stderr, "canwire campaign: %s %" PRIu64 " to %" PRIu64 " %s missing; give the "
                "files of all parts, or --partial\n",
                in->report.source.is_campaign ? "rows" : "seeds", gap.first, gap.last,
                in->report.numbers.count > 1 ? "and others are" : "are");
    return false;
}

void intake_free(intake *in)
{
    jsonread_free(&in->reader);
    runner_free(in->runner);
    campaign_free(in->campaign);
    if (in->report.source.file)
        report_free(&in->report);
}
