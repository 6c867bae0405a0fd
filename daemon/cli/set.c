/* SPDX-License-Identifier: MIT
 *
 * set.c - canwire set: changes settings of a node while the bus runs.
 */
#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "cli/client.h"
#include "cli/command.h"
#include "config/change/live.h"

#include <stdio.h>
#include <string.h>

static const char usage[] = "canwire set BUS NODE KEY=VALUE...";

#define HELP_MAX 8192u
#define KEY_WIDTH 26 /* of the longest key */
#define LINE_MAX_WIDTH 100u

static const char intro[] =
    "Changes settings of a node at once; the configuration's file stays as it is. Keys are those "
    "of\n"
    "the configuration, as in `ip link set ... type can`:\n"
    "\n";

static const char outro[] =
    "\n"
    "A bit timing changes from the node's next bit on, that of the data phase only where the node\n"
    "has one (CAN FD). Delays and places change for the edges that come from now on: one that is\n"
    "under way arrives as it would have. A sample-point finds the data phase anew, too. All other\n"
    "keys, such as when-full, controller and kind, change in the configuration, see `canwire\n"
    "reload`.\n"
    "\n";

/* Prints a key of a node, its values and what it is, in lines of a list. */
static void print_key(FILE *out, const schema_key *key)
{
    char range[LINE_MAX_WIDTH], text[512];
    cfg_print_range(range, sizeof range, key);
    (void)snprintf(text, sizeof text, "%s. %s", range, key->help);
    size_t column = (size_t)fprintf(out, "  %-*s ", KEY_WIDTH, key->name);
    char *rest = text;
    for (char *word; (word = strsep(&rest, " ")) != NULL;) {
        if (column + 1 + strlen(word) > LINE_MAX_WIDTH)
            column = (size_t)fprintf(out, "\n  %-*s ", KEY_WIDTH, "") - 1;
        column += (size_t)fprintf(out, " %s", word);
    }
    (void)fputc('\n', out);
}

/* Puts the help of all keys that change while a node is in use, from their table. */
static const char *set_print_help(char text[HELP_MAX])
{
    FILE *out = fmemopen(text, HELP_MAX, "w");
    if (!out)
        return intro;
    (void)fputs(intro, out);
    for (const schema_key *key = cfg_node_keys; key->name; key++)
        if (cfg_is_live(key))
            print_key(out, key);
    (void)fputs(outro, out);
    (void)fclose(out);
    return text;
}

/* Puts KEY=VALUE into an object. */
static bool put_setting(json_t *settings, char *word)
{
    char *equals = strchr(word, '=');
    if (!equals || equals == word) {
        plain_print(stderr, "canwire set: %s: expected KEY=VALUE\n", word);
        return false;
    }
    *equals = '\0';
    const bool twice = json_object_get(settings, word);
    if (twice)
        plain_print(stderr, "canwire set: %s is given twice\n", word);
    else
        put_text(settings, word, equals + 1);
    *equals = '=';
    return !twice;
}

/* Refuses a setting in the place of a node, as in NODE KEY=VALUE BUS. */
static int refuse_order(const char *first, const char *setting, const char *last)
{
    if (!client_has_listener(first) && client_has_listener(last))
        plain_print(stderr, "canwire set: the bus comes first, and that is %s\nusage: %s\n", last,
                    usage);
    else
        plain_print(stderr, "canwire set: %s: a bus and one of its nodes come before it\n"
                    "usage: %s\n", setting, usage);
    return CLI_USAGE;
}

int cli_set(int argc, char **argv)
{
    int first = 0;
    char text[HELP_MAX];
    const command c = {
        .usage = usage, .help = set_print_help(text), .words_min = 3, .words_max = -1};
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    if (strchr(argv[first + 1], '='))
        return refuse_order(argv[first], argv[first + 1], argv[argc - 1]);
    json_t *settings = json_object();
    for (int i = first + 2; i < argc; i++) {
        if (!put_setting(settings, argv[i])) {
            json_decref(settings);
            return CLI_USAGE;
        }
    }
    json_t *request = client_request("set");
    put_text(request, "node", argv[first + 1]);
    put(request, "settings", settings);
    return client_report(argv[first], request);
}
