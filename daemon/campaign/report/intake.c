/* SPDX-License-Identifier: MIT
 *
 * intake.c - reads files of rows into a report, and refuses rows that do not belong together.
 */
#include "campaign/report/intake.h"

#include "base/text/plain.h"
#include "campaign/report/digest.h"
#include "campaign/report/memory.h"
#include "campaign/report/rowblock.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define DIGITS "0123456789"
#define LARGE_BYTES (8 << 20) /* of a file that is worth several processes */

static const char no_command[] = "its `repeat` is no command that canwire has written";

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

/* Loads the campaign of the rows, whose expectations say which failures are detections. */
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

/* Notes what the commands of all rows have in common: all but the number behind this word. */
static void note_command(intake *in, const char *repeat)
{
    static const char *const words[] = {" --seed ", " --only "};
    const char *word = words[in->report.source.is_campaign];
    const char *last = NULL;
    for (const char *at = repeat; (at = strstr(at, word)) != NULL; at++)
        last = at + strlen(word);
    if (!last)
        return;
    in->command = memory_print("%.*s", (int)(last - repeat), repeat);
    in->command_length = strlen(in->command);
    in->command_end = memory_text(last + strspn(last, DIGITS));
}

/* Begins with the first row, which says where all of them come from. */
static bool intake_begin(intake *in, const char *line, size_t length)
{
    report_row row;
    const char *wrong = report_row_read(&row, &in->reader, line, length, &in->report.signs);
    if (wrong)
        return intake_complain(in, "%s", wrong);
    const bool known = row_source_read(&in->report.source, &row);
    if (known)
        note_command(in, row.repeat);
    const bool good = known ? find_campaign(in) : intake_complain(in, "%s", no_command);
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

/* The functions that follow return what is wrong, to be freed, or NULL. */
static char *check_values(intake *in, const report_row *row, const char *line, size_t length)
{
    const campaign *c = in->campaign;
    if (row->number >= c->rows)
        return memory_print("%s has no row %" PRIu64 ", its last one is %" PRIu64, c->file,
                            row->number, c->rows - 1);
    buffer_clear(&in->head);
    runner_head(in->runner, row->number, &in->head);
    const char *wanted = memory_seen(&in->head);
    const size_t size = buffer_length(&in->head);
    if ((length > size && memcmp(line, wanted, size) == 0) || has_values(row, &in->head))
        return NULL;
    return memory_print("row %" PRIu64 " has other values than %s says; is it of another "
                        "campaign, or has the file changed?",
                        row->number, c->file);
}

/* Without the campaign, the names of the factors must be those of the first row. */
static char *check_names(const intake *in, const report_row *row)
{
    const report *r = &in->report;
    size_t count = 0;
    const jsonread_value *f = jsonread_first(row->factors);
    for (; f; f = jsonread_next(row->factors, f))
        count++;
    bool same = count == r->factor_count;
    for (size_t i = 0; i < r->factor_count && same; i++)
        same = jsonread_get(row->factors, r->factors[i].name) != NULL;
    return same ? NULL
                : memory_text("its factors are not those of the first row: it is of another "
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

/* Returns true for the command of the first row with any number. */
static bool has_same_command(const intake *in, const report_row *row)
{
    const char *number = row->repeat + in->command_length;
    return in->command && row->has_number == in->report.source.is_campaign &&
           strncmp(row->repeat, in->command, in->command_length) == 0 &&
           strspn(number, DIGITS) > 0 &&
           strcmp(number + strspn(number, DIGITS), in->command_end) == 0;
}

/* Returns what is wrong with the command of a row, to be freed, or NULL. Rows of another file would
 * mix two campaigns. */
static char *check_command(const intake *in, const report_row *row)
{
    row_source own;
    char *wrong = NULL;
    if (has_same_command(in, row))
        return NULL;
    if (!row_source_read(&own, row))
        wrong = memory_text(no_command);
    else if (is_of_another(in, &own))
        wrong = memory_print("it is of %s, and the first row is of %s", own.file,
                             in->report.source.file);
    row_source_free(&own);
    return wrong;
}

/* Returns what is wrong with a row, to be freed, or NULL: its values must be those of the
 * campaign. */
static char *check(intake *in, const report_row *row, const char *line, size_t length)
{
    char *wrong = check_command(in, row);
    if (wrong || !in->report.source.is_campaign)
        return wrong;
    return in->campaign ? check_values(in, row, line, length) : check_names(in, row);
}

/* Appends the digest of a line. */
static char *read_row(intake *in, const char *line, size_t length, buffer *digest)
{
    report_row row;
    const char *wrong = report_row_read(&row, &in->reader, line, length, &in->report.signs);
    if (wrong)
        return memory_text(wrong);
    char *other = check(in, &row, line, length);
    if (!other)
        row_digest_write(digest, &row, &in->report);
    return other;
}

/* Adds the row of the line. Returns false after a message. */
static bool take_row(intake *in, const char *digest)
{
    const uint64_t number = row_digest_number(digest);
    if (!spans_add(&in->report.numbers, number))
        return intake_complain(in, "%s %" PRIu64 " is there twice",
                               in->report.source.is_campaign ? "row" : "seed", number);
    row_digest_add(&in->report, digest);
    return true;
}

/* Prints what is wrong with the line, and frees it. */
static bool tell(const intake *in, char *wrong)
{
    (void)intake_complain(in, "%s", wrong);
    free(wrong);
    return false;
}

/* The first line of all also says which campaign the report is about. */
static bool intake_take_line(intake *in, const char *line, size_t length)
{
    if (!in->report.source.file && !intake_begin(in, line, length))
        return false;
    buffer_clear(&in->digest);
    char *wrong = read_row(in, line, length, &in->digest);
    return wrong ? tell(in, wrong) : take_row(in, buffer_first(&in->digest));
}

/* ---- Files ----------------------------------------------------------------------------------- */

/* A line without its end is that of a run that was ended. Returns false after a message. */
static bool pass_cut(const intake *in)
{
    return in->partial ||
           intake_complain(in, "the line is cut; `canwire campaign run --resume` completes the "
                               "file, --partial passes over it");
}

/* Reads rows, of which the last one may be cut off: the run was interrupted. */
static bool read_lines(intake *in, FILE *stream)
{
    char *line = NULL;
    size_t room = 0;
    bool good = true;
    errno = 0;
    for (ssize_t length; good && (length = getline(&line, &room, stream)) > 0;) {
        in->line++;
        if (line[length - 1] != '\n') {
            good = pass_cut(in);
            break;
        }
        good = intake_take_line(in, line, (size_t)length);
    }
    if (good && ferror(stream))
        good = intake_complain(in, "%s", strerror(errno));
    free(line);
    return good;
}

/* ---- Large files ----------------------------------------------------------------------------- */

static char *intake_read_row(void *user, const char *line, size_t length, buffer *digest)
{
    return read_row(user, line, length, digest);
}

static bool intake_take_row(void *user, const char *digest)
{
    intake *in = user;
    in->line++;
    return take_row(in, digest);
}

static bool intake_take_problem(void *user, const char *wrong)
{
    intake *in = user;
    in->line++;
    return wrong ? intake_complain(in, "%s", wrong) : pass_cut(in);
}

/* Reads a file in several processes. */
static bool read_blocks(intake *in, const FILE *stream, uint64_t size)
{
    static const rowblock_calls calls = {.read = intake_read_row, .take = intake_take_row,
                                         .problem = intake_take_problem};
    const rowblock_work work = {.calls = &calls, .user = in, .jobs = in->jobs, .size = size,
                                .fd = fileno((FILE *)stream)};
    const bool good = rowblock_read(&work);
    if (!good && errno)
        plain_print(stderr, "canwire campaign: %s: %s\n", in->file, strerror(errno));
    return good;
}

/* Returns the bytes of a file that is worth several processes; 0: it is not. */
static uint64_t large_size(const intake *in, FILE *stream)
{
    struct stat found;
    if (in->jobs < 2 || fstat(fileno(stream), &found) != 0 || !S_ISREG(found.st_mode))
        return 0;
    return found.st_size >= LARGE_BYTES ? (uint64_t)found.st_size : 0;
}

/* Begins the report with the first line of a file, which is read again. Returns false when it has
 * begun already, or cannot. */
static bool begin_with(intake *in, FILE *stream)
{
    char *line = NULL;
    size_t room = 0;
    const ssize_t length = getline(&line, &room, stream);
    in->line = 1;
    const bool good = length > 0 && intake_begin(in, line, (size_t)length);
    in->line = 0;
    free(line);
    return good;
}

/* Reads a file: a large one in blocks by several processes. */
static bool read_stream(intake *in, FILE *stream)
{
    const uint64_t size = large_size(in, stream);
    if (size == 0)
        return read_lines(in, stream);
    return (in->report.source.file || begin_with(in, stream)) && read_blocks(in, stream, size);
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
    const bool good = is_stdin ? read_lines(in, stream) : read_stream(in, stream);
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
    buffer_free(&in->head);
    buffer_free(&in->digest);
    free(in->command);
    free(in->command_end);
    runner_free(in->runner);
    campaign_free(in->campaign);
    if (in->report.source.file)
        report_free(&in->report);
}
