/* SPDX-License-Identifier: MIT
 *
 * command.c - the command line of the subcommands that talk to a bus.
 */
#include "cli/command.h"

#include "base/text/number.h"
#include "base/text/plain.h"
#include "cli/client.h"

#include <getopt.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#define WAIT_DEFAULT_NS UINT64_C(2000000000)
#define USAGE_BYTES 400

static void command_print_help(FILE *out)
{
    fputs("      --wait T     for a bus that is just starting; default 2s\n"
          "  -h, --help       this text\n"
          "\n"
          "BUS is the name of a bus, whose socket is /run/canwire/BUS.sock, or the path of its\n"
          "socket. Exit status: 0, 1 refused or not reachable, or a value or a file is bad,\n"
          "2 wrong usage.\n",
          out);
}

/* Takes the time that a command waits for a bus; `out` is its name. */
static bool take_wait(void *out, const char *option, const char *text)
{
    cfg_time time = {.ns = 0};
    const char *wrong = text_parse_time(&time, text);
    if (!wrong && time.bits > 0)
        wrong = "expected a time such as 10s, not bits";
    if (wrong)
        plain_print(stderr, "%s: %s %s: %s\n", (const char *)out, option, text, wrong);
    client_set_wait(time.ns);
    return !wrong;
}

/* Returns true for a word that cannot be a bus: a file, or YAML. */
static bool is_no_bus(const char *word)
{
    struct stat found;
    return strpbrk(word, "{[\n") || (stat(word, &found) == 0 && S_ISREG(found.st_mode));
}

/* Returns true when the second word is the bus and the first one is not. A node may have the name
 * of a port's socket, and of another bus. */
static bool is_swapped(const char *first, const char *second)
{
    if (client_has_socket(first))
        return false;
    return (client_has_listener(second) && !client_is_named(first)) ||
           (is_no_bus(first) && !is_no_bus(second));
}

int command_parse(const command *c, int *first, int argc, char **argv)
{
    option_row rows[COMMAND_FLAGS_MAX + 2];
    char usage[USAGE_BYTES];
    size_t count = 0;
    for (; c->options[count].name; count++)
        rows[count] = c->options[count];
    rows[count++] = (option_row){"wait", .read = take_wait, .out = argv[0]};
    rows[count] = (option_row){.name = NULL};
    (void)snprintf(usage, sizeof usage, "usage: %s\n", c->usage);
    const option_table table = {.usage = usage, .help = c->help, .more = command_print_help,
                                .options_first = c->options_first, .rows = rows};
    client_set_wait(WAIT_DEFAULT_NS);
    const int status = options_read(&table, argc, argv);
    if (status >= 0)
        return status;
    int words = argc - optind;
    if (words < c->words_min || (c->words_max >= 0 && words > c->words_max))
        return options_refuse(&table);
    if (words > 1 && !c->is_program && is_swapped(argv[optind], argv[optind + 1])) {
        plain_print(stderr, "%s: the bus comes first, and that is %s\n", argv[0],
                    argv[optind + 1]);
        return options_refuse(&table);
    }
    *first = optind;
    return -1;
}
