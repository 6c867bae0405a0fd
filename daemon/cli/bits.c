/* SPDX-License-Identifier: MIT
 *
 * bits.c - `canwire bits`: the wire bits of a frame, annotated by field.
 */
#include "base/text/counted.h"
#include "base/text/number.h"
#include "base/text/plain.h"
#include "canwire.h"
#include "cli/cli.h"
#include "trace/frametext.h"

#include <getopt.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

#define SHORT_OPTIONS "rnh"
#define COLUMNS_DEFAULT 80 /* in a pipe */
#define COLUMNS_MIN 40     /* the longest field with its gutter fits */
#define COLUMNS_MAX 1000
#define GUTTER 7        /* columns of the row labels */
#define GAP 1           /* columns between fields */
#define PARTS_MAX 96    /* an extended CAN FD frame with 64 bytes has 81 */
#define CELL_MAX 32     /* bytes of a label or value with its final 0 */
#define BASE_ID_BITS 11 /* bits of an extended identifier before SRR */

#define COLOUR_LABEL "\033[36m"
#define COLOUR_STUFF "\033[1;31m"
#define COLOUR_OFF "\033[0m"

typedef struct options {
    const char *frame;
    bool raw;
    bool non_iso;
    bool help;
} options;

/* A field, or one byte of the data field, as it is displayed. */
typedef struct part {
    unsigned first; /* wire bit */
    unsigned count; /* wire bits, stuff bits included, and a fixed stuff bit that follows */
    unsigned width; /* columns */
    char label[CELL_MAX];
    char value[CELL_MAX]; /* in hexadecimal; empty for a single bit and for fixed fields */
} part;

typedef struct display {
    const cw_bits *bits;
    unsigned columns;
    bool colour;
    unsigned part_count;
    part parts[PARTS_MAX];
} display;

/* The lines of a row of parts, from top to bottom. */
typedef enum line_kind {
    LINE_LABEL = 0,
    LINE_NUMBER,
    LINE_LEVEL,
    LINE_RATE, /* of a CAN FD frame */
    LINE_STUFF,
    LINE_VALUE
} line_kind;

#define LINE_COUNT (LINE_VALUE + 1)

static int bits_parse_options(options *out, int argc, char **argv);
static void bits_print_help(void);
static void print_raw(const cw_bits *bits);
static void print_annotated(const cw_frame *frame, const cw_bits *bits);
static void print_summary(const cw_frame *frame, const cw_bits *bits);
static const char *encode(cw_frame *frame, cw_bits *bits, const options *chosen);

int cli_bits(int argc, char **argv)
{
    options chosen = {0};
    int status = bits_parse_options(&chosen, argc, argv);

    if (status != CLI_OK) {
        return status;
    }
    if (chosen.help) {
        bits_print_help();
        return CLI_OK;
    }
    cw_frame frame;
    cw_bits bits;
    const char *problem = encode(&frame, &bits, &chosen);

    if (problem != NULL) {
        plain_print(stderr, "canwire bits: FRAME %s: %s\n", chosen.frame, problem);
        return CLI_BAD_INPUT;
    }
    if (chosen.raw) {
        print_raw(&bits);
    } else {
        print_annotated(&frame, &bits);
        print_summary(&frame, &bits);
    }
    return CLI_OK;
}

/* Makes the bits of a frame. Returns NULL, or what is wrong with it. */
static const char *encode(cw_frame *frame, cw_bits *bits, const options *chosen)
{
    const char *problem = text_parse_frame(frame, chosen->frame);

    if (problem != NULL) {
        return problem;
    }
    if (chosen->non_iso) {
        if (!(frame->flags & CW_FRAME_FD)) {
            return "no CAN FD frame (##), as --fd-non-iso wants it";
        }
        frame->flags |= CW_FRAME_NON_ISO;
    }
    return cw_bits_encode(bits, frame) == CW_OK ? NULL : "not a CAN frame";
}

/* ---- Options --------------------------------------------------------------------------------- */

static void print_usage(FILE *out)
{
    fputs("usage: canwire bits FRAME [--raw] [--fd-non-iso]\n", out);
}

/* Begins with the usage line, which also follows complaints on its own. */
static void bits_print_help(void)
{
    print_usage(stdout);
    fputs(
        "\n"
        "Shows the bits of a frame on the wire, SOF to EOF, with stuff bits and with the ACK\n"
        "slot as the transmitter sends it (1, recessive).\n"
        "\n"
        "  FRAME             123#DEADBEEF, 12345678#00 (8 digits: extended), 123#R4 (remote),\n"
        "                    123#1122334455667788_F (DLC over 8), 123##1DEADBEEF (CAN FD; flags:\n"
        "                    1 BRS, 2 ESI; its data is filled up with 00 to the next length)\n"
        "  -r, --raw         only 0s and 1s, on one line\n"
        "  -n, --fd-non-iso  a CAN FD frame as before ISO 11898-1:2015, without stuff count\n"
        "  -h, --help        this text\n"
        "\n"
        "Rows: field names as in fault rules, number of the field's first bit (bit[N]), levels,\n"
        "stuff bits marked ^, value in hexadecimal. COLUMNS sets the width; NO_COLOR is heeded.\n"
        "For a CAN FD frame also the bit rate: n nominal, d data, m mixed, which changes at the\n"
        "sample point. Fixed stuff bits are marked f, and stand behind the field before them.\n"
        "\n"
        "Exit status: 0, 1 FRAME is not a frame, 2 wrong usage.\n",
        stdout);
}

static int refuse_usage(const char *message, const char *argument)
{
    plain_print(stderr, "canwire bits: %s%s\n", message, argument);
    print_usage(stderr);
    return CLI_USAGE;
}

/* Complains about an option: getopt reports a wrong letter, which may be part of a group, or else
 * the whole argument. */
static int refuse_option(char **argv)
{
    char letter[] = {'-', (char)optopt, '\0'};
    bool is_letter = optopt != 0 && strchr(SHORT_OPTIONS, optopt) == NULL;

    return refuse_usage("wrong option ", is_letter ? letter : argv[optind - 1]);
}

/* Takes the frame, the only argument that is not an option. */
static int bits_take_frame(options *out, int argc, char **argv)
{
    if (out->help) {
        return CLI_OK;
    }
    if (optind == argc) {
        return refuse_usage("a frame is missing", "");
    }
    if (optind + 1 < argc) {
        return refuse_usage("only one frame is taken, not also ", argv[optind + 1]);
    }
    out->frame = argv[optind];
    return CLI_OK;
}

/* Returns CLI_OK to go on, otherwise the exit status. getopt is silent: the complaints are the
 * tool's own. */
static int bits_parse_options(options *out, int argc, char **argv)
{
    static const struct option known[] = {{"raw", no_argument, NULL, 'r'},
                                          {"fd-non-iso", no_argument, NULL, 'n'},
                                          {"help", no_argument, NULL, 'h'},
                                          {NULL, 0, NULL, 0}};
    int option;

    opterr = 0;
    while ((option = getopt_long(argc, argv, SHORT_OPTIONS, known, NULL)) != -1) {
        if (option == 'r') {
            out->raw = true;
        } else if (option == 'n') {
            out->non_iso = true;
        } else if (option == 'h') {
            out->help = true;
        } else {
            return refuse_option(argv);
        }
    }
    return bits_take_frame(out, argc, argv);
}

/* ---- Raw ------------------------------------------------------------------------------------- */

static char level_digit(const cw_bits *bits, unsigned n)
{
    return cw_bits_level(bits, n) == CW_RECESSIVE ? '1' : '0';
}

static void print_raw(const cw_bits *bits)
{
    for (unsigned n = 0; n < bits->length; n++) {
        putchar(level_digit(bits, n));
    }
    putchar('\n');
}

/* ---- Parts ----------------------------------------------------------------------------------- */

static bool is_fixed_stuff(const cw_bits *bits, unsigned n)
{
    return cw_bits_place(bits, n).field == CW_FIELD_FIXED_STUFF;
}

/* Returns true when wire bit n, which is not bit 0, begins a new part. A fixed stuff bit never
 * does. */
static bool begins_part(const cw_bits *bits, unsigned n)
{
    cw_place here = cw_bits_place(bits, n);
    cw_place before = cw_bits_place(bits, is_fixed_stuff(bits, n - 1) ? n - 2 : n - 1);

    if (here.field == CW_FIELD_FIXED_STUFF) {
        return false;
    }
    if (here.field != before.field) {
        return true;
    }
    return here.field == CW_FIELD_DATA && here.index / 8 != before.index / 8;
}

/* Labels a part; the halves of an extended identifier and the bytes of data need an index. */
static void label_part(part *out, const cw_bits *bits)
{
    cw_place place = cw_bits_place(bits, out->first);
    const char *name = cw_field_name(place.field);

    if (place.field == CW_FIELD_DATA) {
        snprintf(out->label, sizeof out->label, "%s[%u]", name, place.index / 8u);
    } else if (place.field == CW_FIELD_ID && (bits->format & CW_BITS_EXTENDED)) {
        bool head = place.index < BASE_ID_BITS;

        snprintf(out->label, sizeof out->label, "%s%s", name, head ? "[0..10]" : "[11..28]");
    } else {
        snprintf(out->label, sizeof out->label, "%s", name);
    }
}

static bool has_value(cw_field field)
{
    return field == CW_FIELD_ID || field == CW_FIELD_DLC || field == CW_FIELD_DATA ||
           field == CW_FIELD_STUFF_COUNT || field == CW_FIELD_CRC;
}

/* Writes the value of the bits without the stuff bits. */
static void value_part(part *out, const cw_bits *bits)
{
    unsigned long value = 0;
    unsigned digits = 0;

    if (!has_value(cw_bits_place(bits, out->first).field)) {
        return;
    }
    for (unsigned n = out->first; n < out->first + out->count; n++) {
        if (!cw_bits_place(bits, n).stuff) {
            value = value << 1 | (unsigned long)cw_bits_level(bits, n);
            digits++;
        }
    }
    snprintf(out->value, sizeof out->value, "%0*lX", (int)(digits + 3) / 4, value);
}

static unsigned greater(unsigned a, unsigned b)
{
    return a > b ? a : b;
}

/* Ends a part before the bit `end`: its label, its value and its width are then known. */
static void complete_part(part *out, const cw_bits *bits, unsigned end)
{
    out->count = end - out->first;
    label_part(out, bits);
    value_part(out, bits);
    out->width = greater(out->count, (unsigned)strlen(out->label));
}

/* Splits the bits into fields, which stay whole when lines are broken. */
static void split_into_parts(display *out)
{
    part *current = &out->parts[0];

    for (unsigned n = 1; n < out->bits->length; n++) {
        if (begins_part(out->bits, n)) {
            complete_part(current, out->bits, n);
            current++;
            current->first = n;
        }
    }
    complete_part(current, out->bits, out->bits->length);
    out->part_count = (unsigned)(current - out->parts) + 1;
}

/* ---- Rows ------------------------------------------------------------------------------------ */

/* Returns the width; COLUMNS takes precedence over the terminal. */
static unsigned display_columns(void)
{
    const char *wish = getenv("COLUMNS");
    uint64_t columns = 0;
    struct winsize size;

    if (wish)
        (void)text_take_digits(&columns, &wish, UINT64_MAX);
    if (columns == 0 && ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) == 0)
        columns = size.ws_col;
    if (columns == 0)
        return COLUMNS_DEFAULT;
    if (columns < COLUMNS_MIN)
        return COLUMNS_MIN;
    return columns < COLUMNS_MAX ? (unsigned)columns : COLUMNS_MAX;
}

/* Returns true for a terminal that shows colours to somebody who has not refused them. */
static bool display_colour(void)
{
    const char *refused = getenv("NO_COLOR");
    const char *terminal = getenv("TERM");

    return isatty(STDOUT_FILENO) != 0 && (refused == NULL || refused[0] == '\0') &&
           (terminal == NULL || strcmp(terminal, "dumb") != 0);
}

/* Returns the part behind the last one that fits into a row with the first. */
static unsigned row_end(const display *shown, unsigned first)
{
    unsigned used = GUTTER + shown->parts[first].width;
    unsigned end = first + 1;

    while (end < shown->part_count && used + GAP + shown->parts[end].width <= shown->columns) {
        used += GAP + shown->parts[end].width;
        end++;
    }
    return end;
}

/* Returns true for a part with a dynamic or fixed stuff bit: only those need the line of marks. */
static bool has_stuff(const display *shown, const part *which)
{
    for (unsigned n = which->first; n < which->first + which->count; n++) {
        if (cw_bits_place(shown->bits, n).stuff) {
            return true;
        }
    }
    return false;
}

/* Prints a text; colour may be NULL. */
static void print_coloured(const display *shown, const char *colour, const char *text)
{
    bool on = shown->colour && colour != NULL;

    printf("%s%s%s", on ? colour : "", text, on ? COLOUR_OFF : "");
}

/* Returns the columns used. */
static unsigned print_text(const display *shown, const char *colour, const char *text)
{
    print_coloured(shown, colour, text);
    return (unsigned)strlen(text);
}

static unsigned print_number(unsigned number)
{
    return (unsigned)printf("%u", number);
}

/* Stuff bits have a colour. Returns the columns used. */
static unsigned print_levels(const display *shown, const part *which)
{
    for (unsigned n = which->first; n < which->first + which->count; n++) {
        char digit[2] = {level_digit(shown->bits, n), '\0'};

        print_coloured(shown, cw_bits_place(shown->bits, n).stuff ? COLOUR_STUFF : NULL, digit);
    }
    return which->count;
}

/* Returns the letter of the rate of a bit (D10). */
static char rate_letter(const cw_bits *bits, unsigned n)
{
    bool here = cw_bits_is_fast(bits, n);
    bool before = n > 0 && cw_bits_is_fast(bits, n - 1);
    bool behind = n + 1u < bits->length && cw_bits_is_fast(bits, n + 1);

    if (here) {
        return 'd';
    }
    return before || behind ? 'm' : 'n';
}

/* Prints one letter for each bit, below its level. Returns the columns used. */
static unsigned print_rates(const display *shown, const part *which)
{
    for (unsigned n = which->first; n < which->first + which->count; n++) {
        putchar(rate_letter(shown->bits, n));
    }
    return which->count;
}

/* Stops at the last mark, so that lines have no trailing blanks. */
static unsigned print_marks(const display *shown, const part *which)
{
    unsigned column = 0;

    for (unsigned i = 0; i < which->count; i++) {
        if (cw_bits_place(shown->bits, which->first + i).stuff) {
            printf("%*s", (int)(i - column), "");
            print_coloured(shown, COLOUR_STUFF,
                           is_fixed_stuff(shown->bits, which->first + i) ? "f" : "^");
            column = i + 1;
        }
    }
    return column;
}

/* Prints the cell of one part on a line; returns the columns used. */
static unsigned print_cell(const display *shown, const part *which, line_kind kind)
{
    switch (kind) {
    case LINE_LABEL:
        return print_text(shown, COLOUR_LABEL, which->label);
    case LINE_NUMBER:
        return print_number(which->first);
    case LINE_LEVEL:
        return print_levels(shown, which);
    case LINE_RATE:
        return print_rates(shown, which);
    case LINE_STUFF:
        return print_marks(shown, which);
    case LINE_VALUE:
        return print_text(shown, NULL, which->value);
    }
    return 0;
}

static bool cell_is_empty(const display *shown, const part *which, line_kind kind)
{
    return (kind == LINE_RATE && !(shown->bits->format & CW_BITS_FD)) ||
           (kind == LINE_STUFF && !has_stuff(shown, which)) ||
           (kind == LINE_VALUE && which->value[0] == '\0');
}

static bool line_is_empty(const display *shown, unsigned first, unsigned end, line_kind kind)
{
    for (unsigned i = first; i < end; i++) {
        if (!cell_is_empty(shown, &shown->parts[i], kind)) {
            return false;
        }
    }
    return true;
}

/* Prints blanks before a cell only when it is known to follow, so that lines have no trailing
 * ones. */
static void bits_print_line(const display *shown, unsigned first, unsigned end, line_kind kind)
{
    static const char *const labels[] = {"field", "bit", "level", "rate", "stuff", "hex"};
    unsigned start = GUTTER; /* column at which the part begins */
    unsigned column = print_text(shown, COLOUR_LABEL, labels[kind]);

    for (unsigned i = first; i < end; i++) {
        const part *which = &shown->parts[i];

        if (!cell_is_empty(shown, which, kind)) {
            printf("%*s", (int)(start - column), "");
            column = start + print_cell(shown, which, kind);
        }
        start += which->width + GAP;
    }
    putchar('\n');
}

/* Prints the fields of a row as lines below each other. Lines without content are left out. */
static void print_row(const display *shown, unsigned first, unsigned end)
{
    for (unsigned kind = 0; kind < LINE_COUNT; kind++) {
        if (!line_is_empty(shown, first, end, (line_kind)kind)) {
            bits_print_line(shown, first, end, (line_kind)kind);
        }
    }
    putchar('\n');
}

/* Prints the frame in rows that fit the width of the terminal. */
static void print_annotated(const cw_frame *frame, const cw_bits *bits)
{
    display shown = {.bits = bits, .columns = display_columns(), .colour = display_colour()};
    char text[FRAME_TEXT_MAX];
    unsigned end;

    text_print_frame(text, frame);
    printf("%s\n\n", text);
    split_into_parts(&shown);
    for (unsigned first = 0; first < shown.part_count; first = end) {
        end = row_end(&shown, first);
        print_row(&shown, first, end);
    }
}

/* ---- Summary --------------------------------------------------------------------------------- */

static const char *fd_text(const cw_frame *frame)
{
    if (!(frame->flags & CW_FRAME_FD)) {
        return "";
    }
    return frame->flags & CW_FRAME_NON_ISO ? " of CAN FD, not ISO" : " of CAN FD";
}

static void print_format(const cw_frame *frame)
{
    bool extended = (frame->flags & CW_FRAME_EXTENDED) != 0;
    bool remote = (frame->flags & CW_FRAME_REMOTE) != 0;

    printf("format      %s %s frame%s\n", extended ? "extended" : "base",
           remote ? "remote" : "data", fd_text(frame));
    printf("identifier  %0*" PRIX32 " (%" PRIu32 ")\n", extended ? 8 : 3, frame->id, frame->id);
}

static void print_dlc(const cw_frame *frame)
{
    unsigned length = cw_frame_length(frame);

    printf("dlc         %u: %s\n", frame->dlc, counted(length, "data byte").text);
}

/* The bits of a frame by kind. */
typedef struct counts {
    unsigned stuff; /* dynamic ones */
    unsigned fixed; /* stuff bits */
    unsigned crc;
    unsigned fast;  /* at the data rate all along */
} counts;

/* Counts the bits of each kind. The stuff count of CAN FD is that of dynamic stuff bits alone. */
static counts count_bits(const cw_bits *bits)
{
    counts found = {0};

    for (unsigned n = 0; n < bits->length; n++) {
        cw_place place = cw_bits_place(bits, n);

        found.fixed += place.field == CW_FIELD_FIXED_STUFF;
        found.stuff += place.stuff && place.field != CW_FIELD_FIXED_STUFF;
        found.crc += place.field == CW_FIELD_CRC && !place.stuff;
        found.fast += cw_bits_is_fast(bits, n);
    }
    return found;
}

/* Prints the duration from SOF to the end of EOF. */
static void print_duration(unsigned length)
{
    printf("duration    %u us at 1 Mbit/s, %u at 500 kbit/s, %u at 250, %u at 125\n", length,
           length * 2, length * 4, length * 8);
}

static void print_microseconds(const char *before, unsigned ns, const char *after)
{
    printf("%s%u.%03u%s", before, ns / 1000, ns % 1000, after);
}

/* Prints the length in bits of either rate, and some durations. BRS is nominal up to the sample
 * point and the CRC delimiter behind it (D10). Both together last a nominal and a data bit,
 * wherever the sample points are. */
static void print_rate_switch(const cw_bits *bits, const counts *found)
{
    unsigned data = found->fast + 1;
    unsigned nominal = bits->length - data;

    printf("rates       %u nominal bits and %u data bits (brs and crc-delimiter: one of each)\n",
           nominal, data);
    print_microseconds("duration    ", nominal * 2000 + data * 500,
                       " us at 500 kbit/s and 2 Mbit/s");
    print_microseconds(", ", nominal * 2000 + data * 200, " at 500 k and 5 M");
    print_microseconds(", ", nominal * 1000 + data * 125, " at 1 M and 8 M\n");
}

/* Prints stuff count, CRC and length of a CAN FD frame, whose rules differ from classical ones. */
static void print_fd_parts(const cw_bits *bits, const counts *found)
{
    if (!(bits->format & CW_BITS_NON_ISO)) {
        printf("stuff count %u: %s before it, modulo 8\n", found->stuff % 8,
               counted(found->stuff, "stuff bit").text);
    }
    printf("crc         %0*" PRIX32 " (CRC-%u)\n", (int)(found->crc + 3) / 4, bits->crc,
           found->crc);
    printf("bits        %u from SOF to EOF, %u of them stuff %s, %u fixed stuff bits\n",
           (unsigned)bits->length, found->stuff, found->stuff == 1 ? "bit" : "bits", found->fixed);
}

/* The duration of a CAN FD frame with BRS depends on two rates, that of others on one. */
static void print_summary(const cw_frame *frame, const cw_bits *bits)
{
    counts found = count_bits(bits);

    print_format(frame);
    print_dlc(frame);
    if (bits->format & CW_BITS_FD) {
        print_fd_parts(bits, &found);
    } else {
        printf("crc         %04X\n", (unsigned)bits->crc);
        printf("bits        %u from SOF to EOF, %u of them stuff %s\n",
               (unsigned)bits->length, found.stuff, found.stuff == 1 ? "bit" : "bits");
    }
    if (found.fast > 0) {
        print_rate_switch(bits, &found);
    } else {
        print_duration(bits->length);
    }
}
