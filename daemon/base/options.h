/* SPDX-License-Identifier: MIT
 *
 * options.h - the options of a command line, read by a table.
 */
#ifndef CANWIRE_BASE_OPTIONS_H
#define CANWIRE_BASE_OPTIONS_H

#include <stdbool.h>
#include <stdio.h>

#define OPTIONS_MAX 24        /* rows of a table */
#define OPTIONS_BAD_VALUE 1   /* exit statuses */
#define OPTIONS_WRONG_USAGE 2

/* An option. It has an argument when there is a `text` or a `read`. */
typedef struct option_row {
    const char *name;  /* as --NAME; NULL ends a table */
    bool *flag;        /* becomes true with the option, or is NULL */
    const char **text; /* becomes the argument */
    /* Takes the argument into `out`; option: "--NAME". Returns false after a message. */
    bool (*read)(void *out, const char *option, const char *text);
    void *out;
    bool may_lack; /* the argument, which then is NULL and not read; else --NAME=ARGUMENT */
    char letter;   /* a short form, or 0 */
} option_row;

typedef struct option_table {
    const char *usage;       /* whole lines */
    const char *help;        /* of --help, behind that and an empty line; or "" */
    void (*more)(FILE *out); /* ... and what that writes, or NULL */
    bool options_first;      /* they end at the first word, whatever follows */
    const option_row *rows;  /* -h and --help are always there */
} option_table;

/* Reads the options of a command line. Returns -1 to go on with the words from argv[optind] on.
 * Otherwise it returns the exit status, and has told why: 0 after --help. */
int options_read(const option_table *table, int argc, char **argv);

/* Shows the usage on standard error. Returns the exit status of wrong usage. */
int options_refuse(const option_table *table);

#endif
