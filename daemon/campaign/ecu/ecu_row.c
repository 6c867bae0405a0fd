/* SPDX-License-Identifier: MIT
 *
 * ecu_row.c - the rows of a campaign with programs at its nodes.
 */
#include "campaign/ecu/ecu_row.h"

#include "base/text/jsonput.h"
#include "base/text/jsontext.h"
#include "base/text/memo.h"
#include "base/text/plain.h"
#include "campaign/ecu/ecu_keeper.h"
#include "campaign/ecu/ecu_network.h"
#include "campaign/scenario.h"
#include "campaign/shellword.h"
#include "campaign/space/variant.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <jansson.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define MODE 0777      /* of folders, less the umask */
#define EXTRA_MS 60000 /* for begin and end of a row */
#define TRIES 1000     /* to make a folder that others remove */
#define CONTROL_MAX 40u /* bytes of the name of the bus that are looked at */

struct ecu_rows {
    const campaign *campaign;
    runner *runner;
    bool keep;
    bool own_network;
    char shown[PATH_MAX]; /* the folder of all rows, as given ... */
    char work[PATH_MAX];  /* ... and absolute */
    char here[PATH_MAX]; /* the folder of the campaign, absolute */
    char directory[PATH_MAX]; /* that of the scenario */
    char tool[PATH_MAX];
    char canwired[PATH_MAX];
    buffer text;
    buffer repeat;
};

/* The state of one row. */
typedef struct one {
    ecu_rows *rows;
    uint64_t number;
    ecu_folder folder;
    ecu_result result;
    arena memory;
    char control[ECU_SOCKET_MAX];
    char bus[CONTROL_MAX + 1];
    uint64_t until_ns;
} one;

/* ---- A program that is the bus by itself ----------------------------------------------------- */

static scenario *ecu_own_fail(ecu_result *result, const char *program, const char *why)
{
    result->verdict = ECU_BROKEN;
    (void)snprintf(result->why, sizeof result->why, "%s: %s", program, why);
    return NULL;
}

/* Returns the object in the first line of the file, to be released; NULL: there is none. */
static json_t *read_head(const char *file)
{
    char *line = NULL;
    size_t size = 0;
    FILE *in = fopen(file, "re");
    if (!in)
        return NULL;
    const ssize_t length = getline(&line, &size, in);
    json_t *head = length > 1 && *line == '#' ? json_loads(line + 1, 0, NULL) : NULL;
    free(line);
    (void)fclose(in);
    return head;
}

/* Opens and runs it. Messages go to a stream. */
static scenario *ecu_own_run(const char *file, uint64_t until_ns, FILE *messages)
{
    const cfg_file named = {.name = file};
    const cfg_time until = {.ns = until_ns};
    scenario *s = scenario_open(&named, messages);
    if (!s)
        return NULL;
    const char *wrong = scenario_set_until(s, until);
    if (!wrong && scenario_run(s, NULL))
        return s;
    char *why = wrong ? NULL : scenario_why(s);
    fprintf(messages, "%s\n", wrong ? wrong : why ? why : "out of memory");
    free(why);
    scenario_close(s);
    return NULL;
}

/* Runs the scenario up to the end of the program. If it cannot be run, the reason is the first line
 * of the messages. */
static scenario *run_told(const char *file, const char *program, ecu_result *result)
{
    memo said;
    FILE *out = memo_begin(&said);
    scenario *s = out ? ecu_own_run(file, result->end_ns, out) : NULL;
    char *messages = memo_text(&said);
    if (!s) {
        if (messages)
            messages[strcspn(messages, "\n")] = '\0';
        (void)ecu_own_fail(result, program, messages && *messages ? messages : "out of memory");
    }
    memo_end(&said);
    return s;
}

/* Runs the scenario that a program has written, up to its end. The result then has that end, and
 * what the program tells. Returns NULL when there is none: the result has a verdict and a reason
 * then. */
static scenario *ecu_own_replay(const char *file, const char *program, ecu_result *result)
{
    json_t *head = read_head(file);
    scenario *s = NULL;
    if (!head)
        return result->verdict == ECU_DONE
                   ? ecu_own_fail(result, program,
                                  "it has ended without a row; canwire.row() makes it")
                   : NULL;
    result->end_ns = (uint64_t)get_number(head, "until_ns");
    if (result->verdict == ECU_CRASHED && *get_any_text(head, "failed"))
        (void)snprintf(result->why, sizeof result->why, "%s: %s", program,
                       get_any_text(head, "failed"));
    if (*get_any_text(head, "broken"))
        (void)ecu_own_fail(result, program, get_any_text(head, "broken"));
    else
        s = run_told(file, program, result);
    json_decref(head);
    return s;
}

/* ---- Paths ----------------------------------------------------------------------------------- */

static bool ecu_row_complain(const char *path, const char *why)
{
    plain_print(stderr, "canwire campaign: %s: %s\n", path, why);
    return false;
}

/* Writes the absolute folder of a file. */
static bool ecu_row_find_folder(char out[PATH_MAX], const char *file)
{
    char folder[PATH_MAX];
    const char *slash = strrchr(file, '/');
    const size_t length = slash ? (size_t)(slash - file) + 1 : 0;
    (void)snprintf(folder, sizeof folder, "%.*s.", (int)length, file);
    return realpath(folder, out) || ecu_row_complain(folder, strerror(errno));
}

/* Finds canwire and canwired: that beside this program, else that of PATH. */
static bool find_programs(ecu_rows *e)
{
    const ssize_t length = readlink("/proc/self/exe", e->tool, sizeof e->tool - 1);
    e->tool[length > 0 ? length : 0] = '\0';
    const char *slash = strrchr(e->tool, '/');
    const int folder = slash ? (int)(slash - e->tool) : 0;
    if (snprintf(e->canwired, sizeof e->canwired, "%.*s/canwired", folder, e->tool) > 0 &&
        faccessat(AT_FDCWD, e->canwired, X_OK, 0) == 0)
        return true;
    (void)snprintf(e->canwired, sizeof e->canwired, "canwired"); /* of PATH */
    return true;
}

/* Another run of the same rows may remove the folder between the two calls, when it ends. */
static bool make_work(ecu_rows *e)
{
    for (unsigned i = 0; i < TRIES; i++) {
        if (mkdirat(AT_FDCWD, e->shown, MODE) != 0 && errno != EEXIST)
            break;
        if (realpath(e->shown, e->work))
            return true;
        if (errno != ENOENT)
            break;
    }
    return ecu_row_complain(e->shown, strerror(errno));
}

/* Finds out whether each row can have a network of its own, and says once if not. */
static void find_network(ecu_rows *e)
{
    if (e->campaign->ecus.host_network)
        return;
    e->own_network = ecu_network_is_possible();
    if (!e->own_network)
        fprintf(stderr, "canwire campaign: the programs have no network of their own here: %s\n",
                strerror(errno));
}

ecu_rows *ecu_rows_new(const campaign *c, runner *r, const char *work, bool keep)
{
    ecu_rows *e = calloc(1, sizeof *e);
    if (!e)
        return NULL;
    e->campaign = c;
    e->runner = r;
    (void)snprintf(e->shown, sizeof e->shown, "%s", work);
    e->keep = keep;
    if (find_programs(e) && ecu_row_find_folder(e->here, c->file) &&
        ecu_row_find_folder(e->directory, c->scenario_name) && make_work(e)) {
        find_network(e);
        return e;
    }
    free(e);
    return NULL;
}

void ecu_rows_free(ecu_rows *e)
{
    if (!e)
        return;
    (void)unlinkat(AT_FDCWD, e->work, AT_REMOVEDIR);
    buffer_free(&e->text);
    buffer_free(&e->repeat);
    free(e);
}

int64_t ecu_rows_limit_ms(const campaign *c)
{
    return c->limit_ms + ecus_grace_ms(&c->ecus) + EXTRA_MS;
}

/* ---- The scenario ---------------------------------------------------------------------------- */

/* Checks the scenario of the row, and takes its name and times. */
static bool check_scenario(one *o, FILE *messages)
{
    const ecu_rows *e = o->rows;
    const campaign *c = e->campaign;
    const cfg_file file = {.name = c->scenario_name, .text = buffer_first(&e->text),
                           .size = buffer_length(&e->text)};
    cfg *config = e->text.no_memory ? NULL : cfg_load_text(&file, messages);
    if (!config)
        return false;
    (void)snprintf(o->bus, sizeof o->bus, "%.*s", (int)CONTROL_MAX, config->bus_name);
    o->until_ns = ECU_NO_TIME;
    if (c->until)
        o->until_ns = text_ticks_ns(text_time_ticks(c->until_time, config->rate));
    cfg_free(config);
    return true;
}

/* The file must be new: the folder was empty when the row took it. */
static bool ecu_row_write_scenario(const one *o)
{
    const buffer *text = &o->rows->text;
    const int fd = ecu_folder_open(&o->folder, ECU_SCENARIO);
    if (fd < 0)
        return false;
    const size_t length = buffer_length(text);
    const bool good = write(fd, buffer_first(text), length) == (ssize_t)length;
    return close(fd) == 0 && good;
}

/* A name with a slash in it is not a name of a file. */
static void name_control(one *o)
{
    const char *name = strchr(o->bus, '/') || strlen(o->bus) > CONTROL_MAX - 8 ? "bus" : o->bus;
    (void)snprintf(o->control, sizeof o->control, "%.64s/%.*s.sock", o->folder.sockets,
                   (int)CONTROL_MAX - 8, name);
}

/* ---- The run --------------------------------------------------------------------------------- */

/* The row has no result. The reason may be in its place already. */
static bool break_off(one *o, const char *why)
{
    o->result.verdict = ECU_BROKEN;
    if (why != o->result.why)
        (void)snprintf(o->result.why, sizeof o->result.why, "%s", why);
    return false;
}

/* Runs canwired and the programs. Returns false when there is no journal. */
static bool ecu_row_run(one *o, uint64_t seed)
{
    ecu_rows *e = o->rows;
    if (!ecu_folder_make(&o->folder, e->work, o->number, o->result.why))
        return break_off(o, o->result.why);
    name_control(o);
    const ecu_task task = {.campaign = e->campaign, .folder = &o->folder, .tool = e->tool,
                           .canwired = e->canwired, .here = e->here, .bus = o->bus,
                           .row = o->number, .seed = seed, .until_ns = o->until_ns,
                           .own_network = e->own_network,
                           .changes = {.plan = &e->campaign->ecus, .sockets = o->folder.sockets,
                                       .control = o->control, .directory = e->directory,
                                       .until_ns = o->until_ns}};
    const char *wrong = ecu_text_change(&e->text, &task.changes, &o->memory);
    if (wrong)
        return break_off(o, wrong);
    if (!ecu_row_write_scenario(o))
        return break_off(o, strerror(errno));
    ecu_keep(&task, &o->result);
    return o->result.verdict != ECU_BROKEN;
}

/* ---- The row --------------------------------------------------------------------------------- */

/* A bench that is done makes no verdict on expectations: the replay of the journal judges them. */
static outcome outcome_of(ecu_verdict verdict)
{
    static const outcome outcomes[] = {[ECU_DONE] = OUTCOME_PASSED,
                                       [ECU_CRASHED] = OUTCOME_CRASHED,
                                       [ECU_LATE] = OUTCOME_TIMEOUT,
                                       [ECU_BROKEN] = OUTCOME_BROKEN};
    return outcomes[verdict];
}

/* Writes what the journal tells. */
static outcome write_replay(one *o, buffer *row)
{
    char file[PATH_MAX + 16];
    memo said;
    FILE *out = memo_begin(&said);
    (void)snprintf(file, sizeof file, "%s/" ECU_JOURNAL, o->folder.files);
    scenario *s = out ? scenario_replay(file, o->result.end_ns, out) : NULL;
    char *messages = memo_text(&said);
    outcome result = OUTCOME_BROKEN;
    if (!s)
        outcome_write_none(row, result, messages ? outcome_first_error(messages) : "out of memory");
    else if (o->result.verdict == ECU_DONE)
        result = outcome_write(row, s);
    else
        result = outcome_write_as(row, s, outcome_of(o->result.verdict), o->result.why);
    scenario_close(s);
    memo_end(&said);
    return result;
}

static bool is_own(const one *o)
{
    return o->rows->campaign->ecus.own_bus;
}

/* Writes what the scenario of the program tells. Returns false when there is none. */
static bool write_own(one *o, buffer *row, outcome *result)
{
    char file[PATH_MAX + 16];
    (void)snprintf(file, sizeof file, "%s/" ECU_RESULT, o->folder.files);
    scenario *s = ecu_own_replay(file, o->rows->campaign->ecus.list[0].name, &o->result);
    *result = outcome_of(o->result.verdict);
    if (!s)
        outcome_write_none(row, *result, o->result.why);
    else if (o->result.verdict == ECU_DONE)
        *result = outcome_write(row, s);
    else
        *result = outcome_write_as(row, s, *result, o->result.why);
    scenario_close(s);
    return s;
}

/* Writes how a program has ended. */
static void write_end(buffer *row, const ecu_end *end)
{
    char text[32] = "running";
    if (!end->started)
        (void)snprintf(text, sizeof text, "not started");
    else if (end->killed)
        (void)snprintf(text, sizeof text, "killed");
    else if (end->ended && WIFSIGNALED(end->status))
        (void)snprintf(text, sizeof text, "signal %s", sigabbrev_np(WTERMSIG(end->status)));
    else if (end->ended)
        (void)snprintf(text, sizeof text, "exit %d", WEXITSTATUS(end->status));
    jsontext_string(row, "end", text);
}

/* Writes the bus time in seconds at which a program was ready; null: it never was, or nobody
 * knows. */
static void write_ready(buffer *row, const ecu_end *end)
{
    jsontext_key(row, "ready");
    if (end->ready && end->ready_ns != ECU_NO_TIME)
        buffer_print(row, "%" PRIu64 ".%09" PRIu64, end->ready_ns / 1000000000u,
                     end->ready_ns % 1000000000u);
    else
        buffer_put(row, "null");
}

/* Writes the end of each program, with the path of its log if the files of the row stay. */
static void write_ecus(const one *o, buffer *row, bool kept)
{
    const ecu_plan *plan = &o->rows->campaign->ecus;
    char log[PATH_MAX + 128];
    jsontext_value(row, "ecus", "{");
    for (size_t i = 0; i < plan->count; i++) {
        jsontext_value(row, plan->list[i].name, "{");
        write_ready(row, &o->result.ends[i]);
        write_end(row, &o->result.ends[i]);
        (void)snprintf(log, sizeof log, "%s/row-%" PRIu64 "/%s.log", o->rows->shown, o->number,
                       plan->list[i].name);
        if (kept)
            jsontext_string(row, "log", log);
        buffer_put(row, "}");
    }
    buffer_put(row, "}");
}

/* The journal repeats a row exactly, as long as it is there; so does the scenario of a program. */
static void write_replay_command(const one *o, buffer *row)
{
    char text[PATH_MAX + 64];
    buffer *command = &o->rows->repeat;
    (void)snprintf(text, sizeof text, "%s/row-%" PRIu64 "/%s", o->rows->shown, o->number,
                   is_own(o) ? ECU_RESULT : ECU_JOURNAL);
    shellword_begin(command, is_own(o) ? "canwire sim" : "canwire sim --journal", text);
    if (o->result.end_ns != ECU_NO_TIME)
        buffer_print(command, " --until %" PRIu64 "ns", o->result.end_ns);
    const char *replay = buffer_text(command);
    jsontext_string(row, "replay", replay ? replay : "");
}

/* The command runs the row anew: programs that depend on real time may do something else then. */
static void write_repeat(const one *o, buffer *row)
{
    buffer *repeat = &o->rows->repeat;
    shellword_begin(repeat, "canwire campaign run", o->rows->campaign->file);
    buffer_print(repeat, " --only %" PRIu64, o->number);
    outcome_end_row(row, repeat);
}

/* Writes the row by what its journal says, or without one by how its run has ended. The files of a
 * row that has passed go. */
static outcome write_row(one *o, buffer *row, bool has_journal)
{
    outcome result = outcome_of(o->result.verdict);
    if (has_journal && is_own(o))
        has_journal = write_own(o, row, &result);
    else if (has_journal)
        result = write_replay(o, row);
    else
        outcome_write_none(row, result, o->result.why);
    const bool made = o->folder.fd >= 0;
    const bool kept = made && (o->rows->keep || result != OUTCOME_PASSED);
    write_ecus(o, row, kept);
    if (kept && has_journal)
        write_replay_command(o, row);
    write_repeat(o, row);
    if (made && !kept)
        ecu_folder_remove(o->folder.files); /* while it is locked: another run may make it anew */
    ecu_folder_close(&o->folder);
    return result;
}

/* Returns false when the values make no scenario, which is in the row then. */
static bool ecu_row_begin(one *o, buffer *row)
{
    memo said;
    FILE *out = memo_begin(&said);
    const bool good = out && check_scenario(o, out);
    if (!good)
        (void)outcome_write_invalid(row, memo_text(&said));
    memo_end(&said);
    return good;
}

outcome ecu_row(ecu_rows *e, uint64_t number, buffer *row)
{
    one o = {.rows = e, .number = number, .folder.fd = -1, .result.end_ns = ECU_NO_TIME};
    choice choices[CAMPAIGN_FACTORS_MAX];
    uint64_t seed = e->campaign->scenario_seed;
    sample_choose(choices, e->campaign, number);
    (void)variant_seed(&seed, e->campaign, choices);
    runner_begin(e->runner, number, row);
    buffer_clear(&e->text);
    variant_text(&e->text, e->campaign, choices);
    if (!ecu_row_begin(&o, row)) {
        write_repeat(&o, row);
        return OUTCOME_INVALID;
    }
    const bool has_journal = ecu_row_run(&o, seed);
    const outcome result = write_row(&o, row, has_journal);
    arena_free(&o.memory);
    return result;
}
