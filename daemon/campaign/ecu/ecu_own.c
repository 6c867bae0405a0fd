/* SPDX-License-Identifier: MIT
 *
 * ecu_own.c - what has become of a row whose program is the bus by itself.
 */
#include "campaign/ecu/ecu_own.h"

#include "base/text/jsonput.h"
#include "base/text/memo.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

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

scenario *ecu_own_replay(const char *file, const char *program, ecu_result *result)
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
