/* SPDX-License-Identifier: MIT
 *
 * inject.c - canwire inject: puts fault rules onto a running bus.
 */
#include "base/text/buffer.h"
#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "cli/client.h"
#include "cli/command.h"
#include "config/profilefile.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/magic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#define TEXT_MAX (1u << 20)
#define READ_BYTES 65536u

static const char help[] =
    "Puts fault rules onto a running bus and prints their names. All of them are taken or none.\n"
    "\n"
    "  FILE   with rules or a profile; - is standard input. A profile may be named: it is looked\n"
    "         for here and beside the configuration of BUS, in `profiles` there and among the\n"
    "         installed ones\n"
    "  YAML   instead: a rule, '{name: x, when: {frame: \"123\"}, do: {flip: \"crc[3]\"}}', a list "
    "of\n"
    "         rules or {faults: [...]}\n"
    "\n"
    "      --keep             also at the next starts, until they are cleared or the machine is\n"
    "                         started anew\n"
    "      --with KEY=VALUE   sets a parameter of a profile; may be given again\n"
    "\n"
    "Options come before BUS. Errors are told as FILE:LINE:COLUMN: message.\n"
    "\n";

/* The text that is sent. */
typedef struct injection {
    const char *name; /* of the text, for messages */
    char file[PATH_MAX]; /* of a profile that was found by its name */
    buffer text;
    buffer with; /* lines to append to the text */
    bool keep;
} injection;

/* Returns false after a message. */
static bool is_whole(const buffer *text)
{
    if (text->no_memory)
        fputs("canwire inject: out of memory\n", stderr);
    return !text->no_memory;
}

/* Turns KEY=VALUE into a line of the map `with`. */
static bool add_parameter(void *out, const char *option, const char *argument)
{
    injection *in = out;
    const char *equals = strchr(argument, '=');
    if (!equals || equals == argument) {
        plain_print(stderr, "canwire inject: %s %s: expected KEY=VALUE\n", option, argument);
        return false;
    }
    if (buffer_length(&in->with) == 0)
        buffer_put(&in->with, "\nwith:\n");
    buffer_print(&in->with, "  %.*s: %s\n", (int)(equals - argument), argument, equals + 1);
    return is_whole(&in->with);
}

/* Reads the text, or as much as exceeds the limit; the bus then refuses it. */
static bool inject_read_all(buffer *text, FILE *in)
{
    while (buffer_length(text) <= TEXT_MAX) {
        if (!buffer_reserve(text, READ_BYTES)) {
            errno = ENOMEM;
            return false;
        }
        size_t count = fread(text->data + text->end, 1, READ_BYTES, in);
        text->end += count;
        if (count == 0)
            return !ferror(in);
    }
    errno = EFBIG;
    return false;
}

/* Returns true for a pipe that has a name. It may have no program at its other end, and would hang
 * then. One of the shell, <(...), has. */
static bool is_named_pipe(int fd)
{
    struct stat found;
    struct statfs within;
    return fstat(fd, &found) == 0 && S_ISFIFO(found.st_mode) && fstatfs(fd, &within) == 0 &&
           within.f_type != PIPEFS_MAGIC;
}

/* Returns NULL with errno. */
static FILE *inject_open_file(const char *file)
{
    const int fd = open(file, O_RDONLY | O_CLOEXEC | O_NOCTTY | O_NONBLOCK);
    if (fd < 0)
        return NULL;
    const bool bad = is_named_pipe(fd);
    FILE *stream = !bad && fcntl(fd, F_SETFL, 0) == 0 ? fdopen(fd, "r") : NULL;
    const int error = bad ? ESPIPE : errno;
    if (!stream)
        (void)close(fd);
    errno = error;
    return stream;
}

/* Reads a file, or standard input for "-". Returns false after a message. */
static bool inject_read_file(injection *in, const char *file)
{
    bool standard = strcmp(file, "-") == 0;
    FILE *stream = standard ? stdin : inject_open_file(file);
    bool good = stream && inject_read_all(&in->text, stream);
    if (!good)
        plain_print(stderr, "canwire inject: %s: %s\n", file,
                    errno == ESPIPE ? "not a regular file" : strerror(errno));
    if (stream && !standard)
        (void)fclose(stream);
    return good;
}

static bool file_exists(const char *word, bool any)
{
    return strcmp(word, "-") == 0 || profilefile_is_there(word, any);
}

/* Returns true for the name of a file: a word without any character of rules in YAML. */
static bool looks_like_file(const char *word)
{
    return strpbrk(word, ":{[\n") == NULL;
}

/* Returns the path of the configuration of a bus. NULL: it has none, or has not answered, which has
 * been told. To be freed. */
static char *file_of_bus(const char *bus)
{
    json_t *reply = client_ask_once(bus, client_request("status"));
    char *path = client_file_of(json_object_get(reply, "status"), "file");
    json_decref(reply);
    return path;
}

/* Finds a profile by its name. Returns false after a message; the caller has one for what is there
 * and no file. */
static bool find_profile(injection *in, const char *bus, const char *name)
{
    char folders[PROFILEFILE_LIST_BYTES];
    char *file = file_of_bus(bus);
    const profilefile wanted = {.name = name, .beside = {"", file}};
    const bool found = file && profilefile_find(in->file, &wanted);
    profilefile_list(folders, &wanted);
    if (file && !found && !file_exists(name, true))
        plain_print(stderr, "canwire inject: there is no %s in %s\n", name, folders);
    free(file);
    return found;
}

/* Reads rules from a file, a profile or the word itself, and adds the parameters. A word that looks
 * like a file is never taken for rules. */
static bool inject_read_text(injection *in, const char *bus, const char *word)
{
    const bool is_file = file_exists(word, true) || looks_like_file(word);
    if (is_file && !file_exists(word, false) && profilefile_is_name(word)) {
        if (find_profile(in, bus, word))
            word = in->file;
        else if (!file_exists(word, true))
            return false;
    }
    in->name = !is_file ? "inject" : strcmp(word, "-") == 0 ? "stdin" : word;
    if (!is_file)
        buffer_put(&in->text, word);
    else if (!inject_read_file(in, word))
        return false;
    (void)buffer_append(&in->text, in->with.data, buffer_length(&in->with));
    return is_whole(&in->text);
}

/* Sends the rules. Their names go to standard output, for scripts; warnings do not. */
static int send_text(const char *bus, const injection *in)
{
    json_t *request = client_request("inject");
    put_text(request, "name", in->name);
    if (in->keep)
        put_bool(request, "keep", true);
    put(request, "text", text_to_json(buffer_first(&in->text), buffer_length(&in->text)));
    json_t *reply = client_ask_once(bus, request);
    const json_t *rules = json_object_get(reply, "rules");
    for (size_t i = 0; i < json_array_size(rules); i++)
        puts(json_string_value(json_array_get(rules, i)));
    const json_t *warnings = json_object_get(reply, "warnings");
    for (size_t i = 0; i < json_array_size(warnings); i++)
        plain_print(stderr, "%s\n", json_string_value(json_array_get(warnings, i)));
    int status = reply ? CLI_OK : CLI_BAD_INPUT;
    json_decref(reply);
    return status;
}

int cli_inject(int argc, char **argv)
{
    injection in = {.name = NULL};
    int first = 0;
    const command c = {.usage = "canwire inject [--keep] [--with KEY=VALUE]... BUS FILE|YAML",
                       .help = help,
                       .words_min = 2,
                       .words_max = 2,
                       .options_first = true,
                       .options = {{"with", .read = add_parameter, .out = &in},
                                   {"keep", .flag = &in.keep}}};
    int status = command_parse(&c, &first, argc, argv);
    if (status < 0)
        status = inject_read_text(&in, argv[first], argv[first + 1]) ? send_text(argv[first], &in)
                                                                     : CLI_BAD_INPUT;
    buffer_free(&in.text);
    buffer_free(&in.with);
    return status;
}
