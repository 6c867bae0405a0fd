/* SPDX-License-Identifier: MIT
 *
 * log.c - messages: to the journal where standard error leads there, else to standard error.
 *
 * Standard error carries no fields to the journal, and a journal that does not read would delay the
 * bus. So a message is a datagram of systemd's journal protocol, sent without waiting.
 */
#include "base/log.h"

#include "base/text/counted.h"
#include "base/text/plain.h"

#include <errno.h>
#include <inttypes.h>
#include <linux/sockios.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define MESSAGE_BYTES 512u
#define NAME_BYTES 64u
#define WHERE_BYTES 256
#define RECORD_BYTES (MESSAGE_BYTES + 400u) /* with all fields */
#define READER_PAUSE_NS 1000000L
#define READER_PAUSES 1000

static const struct sockaddr_un journal_address = {
    .sun_family = AF_UNIX,
    .sun_path = "/run/systemd/journal/socket",
};

typedef enum priority { ERROR = 3, WARNING = 4, INFO = 6 } priority; /* of syslog(3) */

typedef struct message {
    priority priority;
    const char *node; /* or NULL */
    char text[MESSAGE_BYTES];
} message;

static struct {
    pthread_once_t once;
    int journal; /* -1: messages go to standard error */
    char bus[NAME_BYTES];
    const char *program;
    bool rig; /* of several buses */
    bool verbose;
    pthread_mutex_t lock;
    char last_error[LOG_LAST_BYTES]; /* guarded by it */
    atomic_uint lost;
} state = {.once = PTHREAD_ONCE_INIT,
           .journal = -1,
           .program = "canwired",
           .lock = PTHREAD_MUTEX_INITIALIZER};

static _Thread_local const char *entered; /* the bus of a rig, or NULL */

/* ---- Journal --------------------------------------------------------------------------------- */

/* Returns true when standard error is the stream that systemd has connected to the journal, and
 * nothing has replaced it. */
static bool leads_to_journal(void)
{
    const char *stream = getenv("JOURNAL_STREAM");
    uintmax_t device, inode;
    struct stat own;
    return stream && sscanf(stream, "%ju:%ju", &device, &inode) == 2 && fstat(2, &own) == 0 &&
           own.st_dev == device && own.st_ino == inode;
}

void log_end(void)
{
    const struct timespec pause = {.tv_nsec = READER_PAUSE_NS};
    int unread = 0; /* bytes */
    for (int i = 0; state.journal >= 0 && i < READER_PAUSES &&
                    ioctl(state.journal, SIOCOUTQ, &unread) == 0 && unread > 0; i++)
        (void)nanosleep(&pause, NULL);
}

/* Opens the journal once, with the first message. */
static void open_journal(void)
{
    if (leads_to_journal())
        state.journal = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (state.journal >= 0)
        (void)atexit(log_end);
}

/* Adds "KEY=value\n", or nothing for an empty value. Values are short enough. */
static size_t add_field(char record[RECORD_BYTES], size_t used, const char *key, const char *value)
{
    if (!value || !*value)
        return used;
    int length = snprintf(record + used, RECORD_BYTES - used, "%s=%s\n", key, value);
    return used + (size_t)length < RECORD_BYTES ? used + (size_t)length : used;
}

/* Returns 0 or an errno. */
static int send_record(const message *m)
{
    char record[RECORD_BYTES];
    char number[] = {(char)('0' + m->priority), '\0'};
    size_t size = add_field(record, 0, "MESSAGE", m->text);
    size = add_field(record, size, "PRIORITY", number);
    size = add_field(record, size, "SYSLOG_IDENTIFIER", state.program);
    size = add_field(record, size, "CANWIRE_BUS", entered ? entered : state.bus);
    size = add_field(record, size, "CANWIRE_NODE", m->node);
    return sendto(state.journal, record, size, MSG_DONTWAIT | MSG_NOSIGNAL,
                  (const struct sockaddr *)&journal_address, sizeof journal_address) < 0
               ? errno
               : 0;
}

/* Reports lost messages before the next message. */
static void report_lost(void)
{
    unsigned lost = atomic_exchange(&state.lost, 0);
    message m = {.priority = WARNING};
    if (lost == 0)
        return;
    (void)snprintf(m.text, sizeof m.text, "%s lost, the journal did not take %s",
                   counted(lost, "message").text, lost == 1 ? "it" : "them");
    if (send_record(&m) != 0)
        atomic_fetch_add(&state.lost, lost);
}

/* A journal that is full loses the message, which is counted: the bus must not wait. */
static void send_message(const message *m)
{
    report_lost();
    int number = send_record(m);
    if (number == EAGAIN || number == ENOBUFS)
        atomic_fetch_add(&state.lost, 1);
    else if (number != 0) /* there is no journal */
        (void)dprintf(STDERR_FILENO, "<%d>%s\n", (int)m->priority, m->text);
}

/* ---- Messages -------------------------------------------------------------------------------- */

/* Standard error has no field for the priority, so a word says it. */
static const char *word(priority p)
{
    switch (p) {
    case ERROR:
        return "error: ";
    case WARNING:
        return "warning: ";
    case INFO:
        break;
    }
    return "";
}

/* Keeps the last error for log_last_error(). Several threads may log errors at once. */
static void keep_error(const char *text, size_t length)
{
    (void)pthread_mutex_lock(&state.lock);
    (void)snprintf(state.last_error, LOG_LAST_BYTES, "%.*s",
                   (int)(length < LOG_LAST_BYTES ? length : LOG_LAST_BYTES), text);
    (void)pthread_mutex_unlock(&state.lock);
}

/* Writes each message with one call, so that lines of several threads do not mix. It uses the
 * descriptor, since publish.c hides the stream from liblcm for a while. */
static void log_put(message *m)
{
    (void)pthread_once(&state.once, open_journal);
    plain_make(m->text, ' ');
    if (m->priority == ERROR)
        keep_error(m->text, strlen(m->text));
    if (state.journal < 0)
        (void)dprintf(STDERR_FILENO, "%s: %s%s\n", state.program, word(m->priority), m->text);
    else
        send_message(m);
}

/* A message begins with its bus, in a rig, then with a place in a file or NULL, and its node. */
static void __attribute__((format(printf, 4, 0)))
print_at(const char *where, priority p, const char *node, const char *format, va_list args)
{
    message m = {.priority = p, .node = node};
    int used = entered ? snprintf(m.text, sizeof m.text, "%.*s: ", (int)NAME_BYTES, entered) : 0;
    if (where)
        used += snprintf(m.text + used, sizeof m.text - (size_t)used, "%.*s: ", WHERE_BYTES, where);
    if (node)
        used += snprintf(m.text + used, sizeof m.text - (size_t)used, "node %.*s: ",
                         (int)NAME_BYTES, node);
    (void)vsnprintf(m.text + used, sizeof m.text - (size_t)used, format, args);
    log_put(&m);
}

static void __attribute__((format(printf, 3, 0)))
print(priority p, const char *node, const char *format, va_list args)
{
    print_at(NULL, p, node, format, args);
}

void log_set_program(const char *name)
{
    state.program = name;
}

void log_set_bus(const char *bus)
{
    (void)snprintf(state.bus, sizeof state.bus, "%s", bus);
}

void log_set_rig(void)
{
    state.rig = true;
}

const char *log_enter(const char *bus)
{
    const char *before = entered;
    entered = state.rig ? bus : NULL;
    return before;
}

void log_set_verbose(void)
{
    state.verbose = true;
}

void log_detail(const char *format, ...)
{
    va_list args;
    if (!state.verbose)
        return;
    va_start(args, format);
    print(INFO, NULL, format, args);
    va_end(args);
}

void log_info(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print(INFO, NULL, format, args);
    va_end(args);
}

void log_warning(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print(WARNING, NULL, format, args);
    va_end(args);
}

void log_error(const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print(ERROR, NULL, format, args);
    va_end(args);
}

void log_node_info(const char *node, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print(INFO, node, format, args);
    va_end(args);
}

void log_node_warning(const char *node, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print(WARNING, node, format, args);
    va_end(args);
}

void log_node_error_at(const char *where, const char *node, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print_at(where, ERROR, node, format, args);
    va_end(args);
}

void log_node_error(const char *node, const char *format, ...)
{
    va_list args;
    va_start(args, format);
    print(ERROR, node, format, args);
    va_end(args);
}

/* Reports complete lines: unchanged to standard error, or each as a message to the journal. */
static void report_lines(const char *lines, void (*report)(const char *format, ...))
{
    (void)pthread_once(&state.once, open_journal);
    if (state.journal < 0) {
        (void)dprintf(STDERR_FILENO, "%s", lines);
        return;
    }
    for (size_t length; *lines; lines += length + (lines[length] == '\n')) {
        length = strcspn(lines, "\n");
        report("%.*s", (int)length, lines);
    }
}

void log_warnings(const char *lines)
{
    report_lines(lines, log_warning);
}

void log_as_is(const char *lines)
{
    char first[LOG_LAST_BYTES];
    (void)snprintf(first, sizeof first, "%.*s", (int)strcspn(lines, "\n"), lines);
    plain_make(first, '?');
    report_lines(lines, log_error);
    if (*lines)
        keep_error(first, strlen(first));
}

void log_last_error(char out[LOG_LAST_BYTES])
{
    (void)pthread_mutex_lock(&state.lock);
    memcpy(out, state.last_error, LOG_LAST_BYTES);
    (void)pthread_mutex_unlock(&state.lock);
}
