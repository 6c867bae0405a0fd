/* SPDX-License-Identifier: MIT
 *
 * ecu_command.c - the command line of a program at a node, and its environment.
 */
#include "campaign/ecu/ecu_bench.h"

#include "base/arena.h"
#include "campaign/shellword.h"

#include <inttypes.h>
#include <string.h>

#define OWN_WORDS 16u     /* of canwire run and the shell */
#define OWN_VARIABLES 12u

/* Words that are added one after the other. */
typedef struct words {
    arena *memory;
    const char **list;
    size_t count;
    bool no_memory;
} words;

static void ecu_command_add(words *w, const char *word)
{
    w->no_memory = w->no_memory || !word;
    w->list[w->count++] = word;
}

static bool ecu_command_begin(words *w, arena *memory, size_t room)
{
    *w = (words){.memory = memory, .list = arena_alloc(memory, (room + 1) * sizeof *w->list)};
    return w->list;
}

/* ---- The program ----------------------------------------------------------------------------- */

/* A program with a relative path is found from the campaign's folder on. */
static const char *whole_word(words *w, const ecu_task *task, const char *word)
{
    if (*word == '/' || !strchr(word, '/'))
        return word;
    return arena_print(w->memory, "%s/%s", task->here, word);
}

/* Does the same with the first word of a text for a shell, if that is a plain path. */
static const char *whole_text(words *w, const ecu_task *task, const char *text)
{
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                "_-./+@";
    const size_t length = strspn(text, plain);
    const char *word = arena_print(w->memory, "%.*s", (int)length, text);
    const char *whole = word ? whole_word(w, task, word) : NULL;
    if (!whole || whole == word || (text[length] != '\0' && !strchr(" \t\n;&|<>", text[length])))
        return whole ? text : NULL;
    buffer quoted = {.data = NULL};
    shellword_put(&quoted, whole);
    const char *first = buffer_text(&quoted);
    const char *result = first ? arena_print(w->memory, "%s%s", first, text + length) : NULL;
    buffer_free(&quoted);
    return result;
}

/* Adds the command itself: words, or a text for the shell. */
static void add_program(words *w, const ecu_task *task, const ecu *e)
{
    if (e->shell) {
        ecu_command_add(w, "sh");
        ecu_command_add(w, "-c");
        ecu_command_add(w, whole_text(w, task, e->command[0]));
        return;
    }
    ecu_command_add(w, whole_word(w, task, e->command[0]));
    for (size_t i = 1; e->command[i]; i++)
        ecu_command_add(w, e->command[i]);
}

/* Programs get the interface of their node by `canwire run`. */
static void add_run(words *w, const ecu_task *task, const ecu *e)
{
    ecu_command_add(w, task->tool);
    ecu_command_add(w, "run");
    if (task->campaign->ecus.virtual_time)
        ecu_command_add(w, "--virtual");
    ecu_command_add(w, "--bus");
    ecu_command_add(w, task->changes.control);
    ecu_command_add(w, "--as");
    ecu_command_add(w, e->node);
    if (e->interface) {
        ecu_command_add(w, "--interface");
        ecu_command_add(w, e->interface);
    }
    ecu_command_add(w, "--");
}

/* ---- The environment ------------------------------------------------------------------------- */

/* Tells a program its node and socket: one without canwire run connects to that by itself. */
static void ecu_command_add_node(words *w, const ecu_task *task, size_t program)
{
    char port[ECU_SOCKET_MAX];
    ecu_port_path(port, &task->changes, program);
    ecu_command_add(
        w, arena_print(w->memory, "CANWIRE_NODE=%s", task->campaign->ecus.list[program].node));
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_PORT=%s", port));
}

/* A program that is the bus by itself gets its scenario. In Python sets have the same order in each
 * row. */
static void add_row(words *w, const ecu_task *task)
{
    const char *folder = task->folder->files;
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_SCENARIO=%s/" ECU_SCENARIO, folder));
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_RESULT=%s/" ECU_RESULT, folder));
    ecu_command_add(w, task->until_ns == ECU_NO_TIME
                           ? "CANWIRE_UNTIL"
                           : arena_print(w->memory, "CANWIRE_UNTIL=%" PRIu64 "ns", task->until_ns));
    ecu_command_add(w, "PYTHONHASHSEED=0");
}

/* Sets what a program gets to know of its row. Its own variables come last and win. */
static void add_variables(words *w, const ecu_task *task, size_t program)
{
    const ecu *e = &task->campaign->ecus.list[program];
    ecu_command_add(w, "NOTIFY_SOCKET"); /* that of a service which the campaign may be */
    ecu_command_add(w, "PYTHONUNBUFFERED=1");
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_RUN=%s", task->changes.sockets));
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_BUS=%s", task->bus));
    if (e->own_bus)
        add_row(w, task);
    else
        ecu_command_add_node(w, task, program);
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_CAMPAIGN=%s", task->here));
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_ROW=%" PRIu64, task->row));
    ecu_command_add(w, arena_print(w->memory, "CANWIRE_SEED=%" PRIu64, task->seed));
    for (size_t i = 0; e->env && e->env[i]; i++)
        ecu_command_add(w, e->env[i]);
}

/* ---- All of it ------------------------------------------------------------------------------- */

bool ecu_command_make(ecu_start *out, const ecu_task *task, size_t program, arena *memory)
{
    words line, variables;
    const ecu *e = &task->campaign->ecus.list[program];
    if (!ecu_command_begin(&line, memory, OWN_WORDS + ECU_WORDS_MAX) ||
        !ecu_command_begin(&variables, memory, OWN_VARIABLES + ECU_WORDS_MAX))
        return false;
    if (!e->direct)
        add_run(&line, task, e);
    add_program(&line, task, e);
    add_variables(&variables, task, program);
    const char *base = e->cwd ? task->here : task->folder->files;
    const char *own = e->cwd ? e->cwd : e->name;
    out->cwd = *own == '/' ? own : arena_print(memory, "%s/%s", base, own);
    out->words = (char *const *)line.list;
    out->env = variables.list;
    return out->cwd && !line.no_memory && !variables.no_memory;
}
