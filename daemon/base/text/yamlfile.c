/* SPDX-License-Identifier: MIT
 *
 * yamlfile.c - reads one YAML document from a file or text of bounded size.
 */
#include "base/text/yamlfile.h"

#include "base/unit.h"
#include "base/text/yamlmend.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

typedef struct text_buffer {
    const unsigned char *bytes;
    size_t length;
} text_buffer;

/* The counts of the scan so far. */
typedef struct scan {
    diag *errors;
    size_t documents;
    size_t nodes;
    const yaml_limits *limits;
    size_t anchors;
    size_t depth;
} scan;

const yaml_limits yaml_file_limits = {.nodes = 200000, .anchors = 1000, .mended_bytes = 1u << 17};

const yaml_limits yaml_text_limits = {
    .nodes = YAML_TEXT_NODES_MAX, .anchors = 100, .mended_bytes = 1u << 14};

static void skip_mark(text_buffer *text);
static bool has_no_nul(const text_buffer *text, diag *errors);
static bool scan_events(text_buffer *text, const yaml_limits *limits, diag *errors,
                        yaml_mend *mend);
static bool load_document(yaml_document_t *document, const text_buffer *text, diag *errors);

bool yaml_text_load(yaml_document_t *document, const char *text, size_t size,
                    const yaml_limits *limits, diag *errors)
{
    text_buffer buffer = {.bytes = (const unsigned char *)text, .length = size};

    if (size > YAML_FILE_MAX) {
        diag_add(errors, 0, 0, "the file is larger than %u MiB", YAML_FILE_MAX >> 20);
        return false;
    }
    skip_mark(&buffer);
    const char *own = (const char *)buffer.bytes;
    yaml_mend mend = {.bytes_max = limits->mended_bytes};
    /* The scan of the events comes first: limits must hold before the document is built. */
    bool good = has_no_nul(&buffer, errors) && scan_events(&buffer, limits, errors, &mend) &&
                load_document(document, &buffer, errors);
    if (good)
        yaml_mend_restore(&mend, own, document);
    free(mend.text);
    return good;
}

/* Skips a byte order mark, which is not content. Offsets and columns then agree with those of
 * editors. */
static void skip_mark(text_buffer *text)
{
    static const unsigned char mark[] = {0xEF, 0xBB, 0xBF};

    if (text->length < sizeof mark || memcmp(text->bytes, mark, sizeof mark) != 0)
        return;
    text->length -= sizeof mark;
    text->bytes += sizeof mark;
}

/* Reads until the end or one byte over the limit; works for pipes, too. */
static bool yamlfile_read_all(char *bytes, size_t *length, int fd, diag *errors)
{
    if (!bytes) {
        diag_add(errors, 0, 0, "out of memory");
        return false;
    }
    for (*length = 0; *length <= YAML_FILE_MAX;) {
        ssize_t count = read(fd, bytes + *length, YAML_FILE_MAX + 1 - *length);

        if (count == 0)
            return true;
        if (count < 0 && errno != EINTR) {
            diag_add(errors, 0, 0, "cannot read: %s", strerror(errno));
            return false;
        }
        *length += count > 0 ? (size_t)count : 0;
    }
    return true;
}

/* Opens a file. Opening a pipe does not wait for its writer. */
static int yamlfile_open_file(const char *file, bool regular, diag *errors)
{
    struct stat info;
    int fd = open(file, O_RDONLY | O_CLOEXEC | O_NOCTTY | (regular ? O_NONBLOCK : 0));

    if (fd < 0) {
        diag_add(errors, 0, 0, "%s%s", strerror(errno), unit_hint(file, errno));
        return -1;
    }
    if (!regular || (fstat(fd, &info) == 0 && S_ISREG(info.st_mode)))
        return fd;
    diag_add(errors, 0, 0, "not a regular file; canwired reads neither pipes nor devices");
    (void)close(fd);
    return -1;
}

char *yaml_file_read(size_t *size, const char *file, bool regular, diag *errors)
{
    int fd = yamlfile_open_file(file, regular, errors);

    if (fd < 0)
        return NULL;
    char *bytes = malloc(YAML_FILE_MAX + 1);
    bool done = yamlfile_read_all(bytes, size, fd, errors);
    (void)close(fd);
    if (done)
        return bytes;
    free(bytes);
    return NULL;
}

/* Complains about the byte at an offset, counting characters as libyaml does. */
static void complain_at(const text_buffer *text, size_t offset, const char *problem, diag *errors)
{
    size_t line = 1;
    size_t column = 1;

    for (size_t i = 0; i < offset && i < text->length; i++) {
        if (text->bytes[i] == '\n') {
            line++;
            column = 1;
        } else if ((text->bytes[i] & 0xC0) != 0x80) {
            column++;
        }
    }
    diag_add(errors, line, column, "%s", problem);
}

/* Texts of the document are C strings, in which a NUL byte has no place. */
static bool has_no_nul(const text_buffer *text, diag *errors)
{
    const unsigned char *nul = memchr(text->bytes, 0, text->length);

    if (nul)
        complain_at(text, (size_t)(nul - text->bytes), "NUL bytes are not allowed", errors);
    return !nul;
}

/* Starts a parser. Returns false when there is no memory for it. */
static bool start_parser(yaml_parser_t *parser, const text_buffer *text, diag *errors)
{
    if (!yaml_parser_initialize(parser)) {
        diag_add(errors, 0, 0, "out of memory");
        return false;
    }
    yaml_parser_set_encoding(parser, YAML_UTF8_ENCODING);
    yaml_parser_set_input_string(parser, text->bytes, text->length);
    return true;
}

/* Returns true when character number n of the text is a tab. */
static bool is_tab(const text_buffer *text, size_t n)
{
    size_t i = 0;

    while (i < text->length && (n > 0 || (text->bytes[i] & 0xC0) == 0x80))
        n -= (text->bytes[i++] & 0xC0) != 0x80;
    return i < text->length && text->bytes[i] == '\t';
}

/* Reports the parser's problem at its place. A tab, which editors do not show, is named. */
static void complain_syntax(const yaml_parser_t *parser, const text_buffer *text, diag *errors)
{
    const yaml_mark_t *mark = &parser->problem_mark;
    const char *problem = parser->problem ? parser->problem : "unknown error";

    /* yaml_parser_load() sets no error when it has no memory for a node. */
    if (parser->error == YAML_MEMORY_ERROR || parser->error == YAML_NO_ERROR)
        diag_add(errors, 0, 0, "out of memory");
    else if (parser->error == YAML_READER_ERROR)
        complain_at(text, parser->problem_offset, problem, errors);
    else
        diag_add(errors, mark->line + 1, mark->column + 1, "%s%s%s%s",
                 parser->context ? parser->context : "", parser->context ? ": " : "", problem,
                 is_tab(text, mark->index) ? " (a tab; YAML is indented with spaces)" : "");
}

/* Counts one more. Returns false after a complaint when that is one too many. */
static bool within(scan *self, size_t *count, size_t max, const yaml_mark_t *mark, const char *what)
{
    if (++*count <= max)
        return true;
    diag_add(self->errors, mark->line + 1, mark->column + 1, "a file has at most %zu %s", max,
             what);
    return false;
}

static bool check_depth(scan *self, const yaml_mark_t *mark)
{
    return within(self, &self->depth, YAML_DEPTH_MAX, mark, "lists and maps in each other");
}

/* Refuses tags, which would give a value another meaning, and too many values or anchors. */
static bool yamlfile_check_node(scan *self, const yaml_mark_t *mark, const yaml_char_t *anchor,
                                const yaml_char_t *tag)
{
    if (tag) {
        diag_add(self->errors, mark->line + 1, mark->column + 1, "YAML tags (%s) are not supported",
                 (const char *)tag);
        return false;
    }
    if (anchor && !within(self, &self->anchors, self->limits->anchors, mark, "anchors"))
        return false;
    return within(self, &self->nodes, self->limits->nodes, mark, "values");
}

/* Checks the size of a value: aliases may name it in many places, and each of them reads it
 * again. */
static bool check_size(scan *self, const yaml_event_t *event)
{
    const yaml_mark_t *mark = &event->start_mark;

    if (!event->data.scalar.anchor || event->data.scalar.length <= YAML_ANCHORED_MAX)
        return true;
    diag_add(self->errors, mark->line + 1, mark->column + 1,
             "a text with an anchor has at most %u bytes", YAML_ANCHORED_MAX);
    return false;
}

/* Checks one event against the limits before anything is loaded: a small text can mean a large
 * document. */
static bool check_event(scan *self, const yaml_event_t *event)
{
    const yaml_mark_t *mark = &event->start_mark;

    switch (event->type) {
    case YAML_DOCUMENT_START_EVENT:
        return within(self, &self->documents, 1, mark, "document");
    case YAML_ALIAS_EVENT:
        return yamlfile_check_node(self, mark, NULL, NULL);
    case YAML_SCALAR_EVENT:
        return check_size(self, event) &&
               yamlfile_check_node(self, mark, event->data.scalar.anchor, event->data.scalar.tag);
    case YAML_SEQUENCE_START_EVENT:
        return check_depth(self, mark) &&
               yamlfile_check_node(self, mark, event->data.sequence_start.anchor,
                                   event->data.sequence_start.tag);
    case YAML_MAPPING_START_EVENT:
        return check_depth(self, mark) &&
               yamlfile_check_node(self, mark, event->data.mapping_start.anchor,
                                   event->data.mapping_start.tag);
    case YAML_SEQUENCE_END_EVENT:
    case YAML_MAPPING_END_EVENT:
        self->depth--;
        return true;
    case YAML_NO_EVENT:
    case YAML_STREAM_START_EVENT:
    case YAML_STREAM_END_EVENT:
    case YAML_DOCUMENT_END_EVENT:
        return true;
    }
    return true;
}

/* Scans the events. Returns false after a report, or with *wrong set after a syntax error. */
static bool scan_parser(yaml_parser_t *parser, const yaml_limits *limits, bool *wrong, diag *errors)
{
    scan counts = {.errors = errors, .limits = limits};
    bool good = true;
    bool more = true;

    while (good && more) {
        yaml_event_t event;

        *wrong = !yaml_parser_parse(parser, &event);
        if (*wrong)
            return false;
        good = check_event(&counts, &event);
        more = event.type != YAML_STREAM_END_EVENT;
        yaml_event_delete(&event);
    }
    return good;
}

/* Scans all events once; *again: a text was mended, and the scan must be repeated. */
static bool scan_once(const text_buffer *text, const yaml_limits *limits, bool *again, diag *errors,
                      yaml_mend *mend, const char *own)
{
    yaml_parser_t parser;
    bool wrong = false;

    *again = false;
    if (!start_parser(&parser, text, errors))
        return false;
    bool good = scan_parser(&parser, limits, &wrong, errors);
    if (wrong && parser.error == YAML_PARSER_ERROR)
        *again = yaml_mend_try(mend, own, text->length, &parser.problem_mark, errors);
    if (wrong && !*again)
        complain_syntax(&parser, text, errors);
    yaml_parser_delete(&parser);
    return good;
}

/* Finds all syntax errors, and more than one document. The text may be a mended one afterwards. */
static bool scan_events(text_buffer *text, const yaml_limits *limits, diag *errors, yaml_mend *mend)
{
    const char *own = (const char *)text->bytes;
    bool again = true;
    bool good = false;

    while (again) {
        good = scan_once(text, limits, &again, errors, mend, own);
        text->bytes = (const unsigned char *)yaml_mend_text(mend, own);
    }
    return good;
}

/* Loads the document that scan_events() has found good. */
static bool load_document(yaml_document_t *document, const text_buffer *text, diag *errors)
{
    yaml_parser_t parser;

    if (!start_parser(&parser, text, errors))
        return false;
    bool good = yaml_parser_load(&parser, document);
    if (!good)
        complain_syntax(&parser, text, errors);
    yaml_parser_delete(&parser);
    return good;
}
