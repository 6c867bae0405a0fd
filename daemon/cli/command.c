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
#define OPTION_BASE 256 /* first value of our options for getopt, beyond all letters */

static void command_print_help(const command *c)
{
    printf("usage: %s\n\n%s"
           "      --wait T     for a bus that is just starting; default 2s\n"
           "  -h, --help       this text\n"
           "\n"
           "BUS is the name of a bus, whose socket is /run/canwire/BUS.sock, or the path of its\n"
           "socket. Exit status: 0, 1 refused or not reachable, or a value or a file is bad,\n"
           "2 wrong usage.\n",
           c->usage, c->help);
}

static int command_refuse(const command *c)
{
    plain_print(stderr, "usage: %s\n", c->usage);
    return CLI_USAGE;
}

static void fill_in(struct option known[COMMAND_FLAGS_MAX + 3], const command *c)
{
    int i;
    for (i = 0; c->options[i].name; i++)
        known[i] = (struct option){c->options[i].name,
                                   c->options[i].text ? required_argument : no_argument, NULL,
                                   OPTION_BASE + i};
    known[i++] = (struct option){"wait", required_argument, NULL, 'w'};
    known[i++] = (struct option){"help", no_argument, NULL, 'h'};
    known[i] = (struct option){NULL, 0, NULL, 0};
}

static bool take_wait(const command *c, const char *text)
{
    const char *name = c->usage + strlen("canwire ");
    cfg_time time = {.ns = 0};
    const char *wrong = text_parse_time(&time, text);
    if (!wrong && time.bits > 0)
        wrong = "expected a time such as 10s, not bits";
    if (wrong)
        plain_print(stderr, "canwire %.*s: --wait %s: %s\n", (int)strcspn(name, " "), name, text,
                    wrong);
    client_set_wait(time.ns);
    return !wrong;
}

static bool command_take_option(const command *c, int value)
{
    if (value == 'w')
        return take_wait(c, optarg);
    const command_option *option = &c->options[value - OPTION_BASE];
    if (option->text)
        return option->text(c->user, optarg);
    *option->flag = true;
    return true;
}

/* Returns true for a word that can be no bus: a file, or YAML. */
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
    struct option known[COMMAND_FLAGS_MAX + 3];
    int value;
    fill_in(known, c);
    client_set_wait(WAIT_DEFAULT_NS);
    optind = 0; /* starts anew after earlier calls of getopt */
    while ((value = getopt_long(argc, argv, c->options_first ? "+h" : "h", known, NULL)) != -1) {
        if (value == 'h') {
            command_print_help(c);
            return CLI_OK;
        }
        if (value == '?')
            return command_refuse(c);
        if (!command_take_option(c, value))
            return CLI_BAD_INPUT;
    }
    int words = argc - optind;
    if (words < c->words_min || (c->words_max >= 0 && words > c->words_max))
        return command_refuse(c);
    if (words > 1 && !c->is_program && is_swapped(argv[optind], argv[optind + 1])) {
        plain_print(stderr, "%s: the bus comes first, and that is %s\n", argv[0],
                    argv[optind + 1]);
        return command_refuse(c);
    }
    *first = optind;
    return -1;
}
