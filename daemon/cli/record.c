/* SPDX-License-Identifier: MIT
 *
 * record.c - canwire record: records the events of a bus in a file or a stream of the user.
 */
#include "base/text/number.h"
#include "base/text/plain.h"
#include "base/file/spool.h"
#include "cli/command.h"
#include "cli/record_bus.h"

#include <string.h>
#include <unistd.h>

static const char help[] =
    "Writes what happens on a bus into FILE until you press Ctrl-C: every frame, in a capture\n"
    "also error frames. The bus does not wait; how many events were lost, since this or the disk\n"
    "was too slow, is told. When FILE has reached the size it becomes FILE.1, that FILE.2 and so\n"
    "on. FILE - is standard output, at once and of any length: | wireshark -k -i -\n"
    "\n"
    "      --format F   candump (default for .log, .candump) or pcapng (.pcapng, for Wireshark)\n"
    "      --size S     64kB to 1000GB; default 100MB\n"
    "      --files N    that are kept, 1 to 1000; default 5\n";

typedef struct recording {
    record_order order;
    bool has_format;
    bool has_limits; /* of the size, or the number of files */
} recording;

/* ---- Options --------------------------------------------------------------------------------- */

/* The format that is named wins over the ending of the file. */
static bool take_format(void *out, const char *option, const char *text)
{
    recording *r = out;
    r->has_format = cfg_record_format_of_name(&r->order.what.format, text);
    if (!r->has_format)
        plain_print(stderr, "canwire record: %s %s: expected candump or pcapng\n", option,
                    text);
    return r->has_format;
}

static bool take_size(void *out, const char *option, const char *text)
{
    const char *wrong = cfg_record_parse_size(out, text);
    if (wrong)
        plain_print(stderr, "canwire record: %s %s: %s\n", option, text, wrong);
    return !wrong;
}

/* Takes the number of files that stay, the present one included. */
static bool take_files(void *out, const char *option, const char *text)
{
    uint64_t number = 0;
    bool good = !text_parse_uint(&number, text) && number >= 1 && number <= SPOOL_FILES_MAX;
    if (!good)
        plain_print(stderr, "canwire record: %s %s: expected a number from 1 to %u\n", option, text,
                    SPOOL_FILES_MAX);
    *(uint32_t *)out = (uint32_t)number;
    return good;
}

static int record_refuse(const char *file, const char *why)
{
    plain_print(stderr, "canwire record: %s: %s\n", file, why);
    return CLI_USAGE;
}

/* Chooses the format. Returns -1 to go on, otherwise the exit status. */
static int complete_format(recording *r)
{
    const char *file = r->order.what.file;
    if (!r->has_format && strcmp(file, "-") == 0)
        return record_refuse(file, "standard output says no format: --format is needed");
    if (!r->has_format && !cfg_record_format_of_file(&r->order.what.format, file))
        return record_refuse(
            file, "the name ends in none of .log, .candump and .pcapng: --format is needed");
    if (r->order.what.format != CFG_RECORD_VCD)
        return -1;
    plain_print(stderr,
                "canwire record: VCD needs every bit, which the control socket does not carry: "
                "use 'record' in the configuration, or canwire sim --vcd\n");
    return CLI_BAD_INPUT;
}

/* Takes standard output for "-". Returns -1 to go on, otherwise the exit status. */
static int complete_stream(recording *r)
{
    static char name[] = "standard output";
    const char *file = r->order.what.file;
    if (strcmp(file, "-") != 0)
        return -1;
    if (r->has_limits)
        return record_refuse(file, "standard output is not rotated: without --size and --files");
    if (r->order.what.format == CFG_RECORD_PCAPNG && isatty(STDOUT_FILENO))
        return record_refuse(file, "a terminal cannot show pcapng: give it to a program");
    r->order.what.file = name;
    r->order.stream = STDOUT_FILENO;
    return -1;
}

int cli_record(int argc, char **argv)
{
    int first = 0;
    recording r = {.order = {.stream = -1, .tool = "canwire record"}};
    const command c = {.usage = "canwire record BUS FILE [--format FORMAT] [--size SIZE] "
                                "[--files N]",
                       .help = help,
                       .words_min = 2,
                       .words_max = 2,
                       .options = {{"format", .read = take_format, .out = &r},
                                   {"size", .read = take_size, .out = &r.order.what.size,
                                    .flag = &r.has_limits},
                                   {"files", .read = take_files, .out = &r.order.what.files,
                                    .flag = &r.has_limits}}};
    cfg_record_default(&r.order.what);
    int status = command_parse(&c, &first, argc, argv);
    if (status >= 0)
        return status;
    r.order.what.file = argv[first + 1];
    status = complete_format(&r);
    if (status < 0)
        status = complete_stream(&r);
    return status >= 0 ? status : record_bus(argv[first], &r.order);
}
