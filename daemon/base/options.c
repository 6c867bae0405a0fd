/* SPDX-License-Identifier: MIT
 *
 * options.c - the options of a command line, read by a table.
 */
#include "base/options.h"

#include <assert.h>
#include <getopt.h>

#define FIRST 256 /* value of the first row for getopt, beyond all letters */
#define NAME_BYTES 64

/* Makes what getopt wants: the long forms, and the letters of the short ones. */
static void prepare(struct option known[OPTIONS_MAX + 2], char letters[2 * OPTIONS_MAX + 3],
                    const option_table *table)
{
    int i = 0;
    if (table->options_first)
        *letters++ = '+';
    for (const option_row *row = table->rows; row->name; row++, i++) {
        const int argument = row->may_lack            ? optional_argument
                             : row->text || row->read ? required_argument
                                                      : no_argument;
        assert(i < OPTIONS_MAX);
        known[i] = (struct option){row->name, argument, NULL,
                                   row->letter ? row->letter : FIRST + i};
        if (row->letter)
            *letters++ = row->letter;
        if (row->letter && argument == required_argument)
            *letters++ = ':';
    }
    known[i++] = (struct option){"help", no_argument, NULL, 'h'};
    known[i] = (struct option){NULL, 0, NULL, 0};
    *letters++ = 'h';
    *letters = '\0';
}

/* Takes an option into what its row has: a flag, a text, a reader. False: the reader has refused
 * the value. */
static bool take(const option_row *row)
{
    char name[NAME_BYTES];
    if (row->flag)
        *row->flag = true;
    if (row->text)
        *row->text = optarg;
    (void)snprintf(name, sizeof name, "--%s", row->name);
    return !row->read || !optarg || row->read(row->out, name, optarg);
}

/* Finds the row of the value that getopt returns: a letter, or the place of a long form. */
static const option_row *find_row(const option_table *table, int value)
{
    const option_row *row = table->rows;
    while (value < FIRST && row->letter != value)
        row++;
    return value < FIRST ? row : &table->rows[value - FIRST];
}

int options_read(const option_table *table, int argc, char **argv)
{
    struct option known[OPTIONS_MAX + 2];
    char letters[2 * OPTIONS_MAX + 3];
    int value;
    prepare(known, letters, table);
    optind = 0; /* starts anew after earlier calls of getopt */
    while ((value = getopt_long(argc, argv, letters, known, NULL)) != -1) {
        if (value == '?')
            return options_refuse(table);
        if (value != 'h') {
            if (!take(find_row(table, value)))
                return OPTIONS_BAD_VALUE;
            continue;
        }
        printf("%s%s%s", table->usage, *table->help ? "\n" : "", table->help);
        if (table->more)
            table->more(stdout);
        return 0;
    }
    return -1;
}

int options_refuse(const option_table *table)
{
    fputs(table->usage, stderr);
    return OPTIONS_WRONG_USAGE;
}
