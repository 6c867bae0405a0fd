/* SPDX-License-Identifier: MIT
 *
 * client.c - asks a running canwired at its control socket.
 */
#include "cli/client.h"

#include "base/text/chars.h"
#include "base/text/jsonput.h"
#include "base/text/plain.h"
#include "base/wall.h"
#include "cli/buses.h"
#include "cli/cli.h"

#include <errno.h>
#include <poll.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#define PATIENCE_S 30 /* by default for a reply: a reload may take 10 s */

#define NS_PER_S 1000000000
#define NS_PER_US 1000
#define US_PER_S 1000000
#define LEAST_NS 100000000 /* for a bus of several */
#define PAUSE_NS 10000000L /* between two looks for a bus that is just starting */

#define NAME_PATIENCE_S 2 /* for each bus that may have a name */
#define NAMES_BYTES 1024 /* of buses in a message */
#define ELLIPSIS "..."
#define MESSAGE_BYTES 16384 /* of a message; a longer one is cut */

static void client_print_line(const char *text)
{
    fprintf(stderr, "%s\n", text);
}

static void (*teller)(const char *text) = client_print_line;
static int reply_patience_s = PATIENCE_S;
static uint64_t wait_ns;   /* for buses that are just starting */
static int64_t wait_began; /* 0: not yet */
static bool allow_doubt;   /* see client_allow_doubt() */
static bool pass_over;     /* sockets of another type, without a message ... */
static bool passed_over;   /* ... and the last one was such */
static int64_t all_until;  /* the end of asking several buses at once; 0: of one */
static int failure;        /* errno of the last bus that could not be asked */
static char silent[NAMES_BYTES]; /* sockets whose buses have not even said their names ... */
static char closed[NAMES_BYTES]; /* ... and those for other users, at the last look for a name */
static char configured[NAMES_BYTES]; /* those whose configuration or rig has that name */

void client_set_teller(void (*tell)(const char *text))
{
    teller = tell;
}

void client_set_patience(int seconds)
{
    reply_patience_s = seconds;
}

void client_set_wait(uint64_t ns)
{
    wait_ns = ns;
}

void client_allow_doubt(void)
{
    allow_doubt = true;
}

bool client_wait(int error)
{
    const struct timespec pause = {.tv_nsec = PAUSE_NS};
    if ((error != ENOENT && error != ECONNREFUSED) || wait_ns == 0)
        return false;
    if (wait_began == 0)
        wait_began = wall_ns();
    if ((uint64_t)(wall_ns() - wait_began) >= wait_ns)
        return false;
    (void)nanosleep(&pause, NULL);
    return true;
}

/* Makes a text printable: texts of a bus, and names in them, may contain any characters. */
static void print_plain(char *text)
{
    plain_make(text, '?');
    teller(text);
}

/* Prints a message with the name of the bus. A long one is cut: nothing may fail here. */
static void __attribute__((format(printf, 2, 3)))
client_complain(const client *c, const char *format, ...)
{
    char text[MESSAGE_BYTES];
    va_list args;
    va_start(args, format);
    int used = snprintf(text, sizeof text, "canwire: bus %.*s: ", MESSAGE_BYTES / 2, c->bus);
    (void)vsnprintf(text + used, sizeof text - (size_t)used, format, args);
    va_end(args);
    print_plain(text);
}

/* ---- Connecting ------------------------------------------------------------------------------ */

static bool is_path(const char *bus)
{
    return strchr(bus, '/') != NULL;
}

static bool is_socket(const char *path)
{
    struct stat found;
    return stat(path, &found) == 0 && S_ISSOCK(found.st_mode);
}

/* Writes the path of the socket of a bus. It may be a socket in the current folder when no bus has
 * that name. Returns false when the path is too long. */
static bool find_socket(struct sockaddr_un *address, const char *bus)
{
    char *path = address->sun_path;
    const size_t room = sizeof address->sun_path;
    int length = is_path(bus) ? snprintf(path, room, "%s", bus)
                              : snprintf(path, room, "%s/%s.sock", buses_folder(), bus);
    if (!is_path(bus) && !(length >= 0 && (size_t)length < room && is_socket(path)) &&
        is_socket(bus))
        length = snprintf(path, room, "%s", bus);
    address->sun_family = AF_UNIX;
    return length >= 0 && (size_t)length < room;
}

bool client_has_socket(const char *bus)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    return find_socket(&address, bus) && is_socket(address.sun_path);
}

bool client_has_listener(const char *bus)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    return find_socket(&address, bus) && is_socket(address.sun_path) &&
           buses_listener(address.sun_path) != BUSES_NOBODY;
}

/* Adds a name to a list. One without room leaves "...". */
static void add_name(char list[NAMES_BYTES], const char *name)
{
    const size_t used = strlen(list), more = strlen(name) + strlen(", ");
    if (used + more + sizeof ", " ELLIPSIS <= NAMES_BYTES)
        (void)sprintf(list + used, "%s%s", used > 0 ? ", " : "", name);
    else if (used < strlen(ELLIPSIS) || strcmp(list + used - strlen(ELLIPSIS), ELLIPSIS) != 0)
        strcpy(list + used, ", " ELLIPSIS);
}

/* Names the buses that there are: it may have another name than its file or its unit. */
static void complain_of_absence(const client *c, const char *unit)
{
    char *names[BUSES_MAX];
    char text[NAMES_BYTES] = "";
    const size_t count = is_path(c->bus) ? 0 : buses_find(names, BUSES_MAX, true);
    const int error = is_path(c->bus) ? 0 : buses_error();
    for (size_t i = 0; i < count; i++) {
        add_name(text, names[i]);
        free(names[i]);
    }
    if (*configured)
        client_complain(c, "that is a configuration; its buses in %s: %s", buses_folder(),
                        configured);
    else if (strchr(c->bus, '.') && !is_path(c->bus))
        client_complain(c, "no such bus or socket: a bus has a name, or the path of its socket");
    else if (count > 0)
        client_complain(c, "%s; those in %s: %s%s%s%s%s%s",
                        *silent || *closed ? "not found" : "no such bus", buses_folder(), text,
                        *silent ? "; it may be one that does not answer: " : "", silent,
                        *closed ? "; it may be one of other users (are you in the group "
                                  "canwire?): " : "", closed, *closed ? ": Permission denied" : "");
    else if (error != 0)
        client_complain(c, "%s: %s (are you in the group canwire?)", buses_folder(),
                        strerror(error));
    else
        client_complain(c, "no such bus (is %s running?)", unit);
}

/* Says why a bus cannot be reached, and what its user can do about that. */
static void complain_unreachable(const client *c, const char *path, int error)
{
    char unit[64] = "canwired";
    if (!is_path(c->bus))
        (void)snprintf(unit, sizeof unit, "canwired@%.40s", c->bus);
    if (error == ENOENT)
        complain_of_absence(c, unit);
    else if (error == ECONNREFUSED)
        client_complain(c, "nobody listens at %s (is %s running?)", path, unit);
    else if (error == EACCES)
        client_complain(c, "%s: %s (are you in the group canwire?)", path, strerror(error));
    else if (error == EAGAIN)
        client_complain(c, "%s: it does not answer", path);
    else
        client_complain(c, "%s: %s", path, strerror(error));
}

/* Returns the moment up to which a bus is waited for. When several are asked at once, each has a
 * moment, also after others have hung for all the time. */
static int64_t end_of_patience(void)
{
    const int64_t now = wall_ns();
    if (all_until == 0)
        return now + (int64_t)reply_patience_s * NS_PER_S;
    return all_until > now + LEAST_NS ? all_until : now + LEAST_NS;
}

/* Limits the wait of connect() for a canwired that is stopped or hangs, with many clients. */
static void set_patience(int fd)
{
    const int64_t left_us = (end_of_patience() - wall_ns()) / NS_PER_US + 1; /* 0: no limit */
    const struct timeval patience = {.tv_sec = left_us / US_PER_S, .tv_usec = left_us % US_PER_S};
    (void)setsockopt(fd, SOL_SOCKET, SO_SNDTIMEO, &patience, sizeof patience);
}

/* Connects, and waits for a bus that is just starting. Returns 0 or an errno. */
static int client_connect_to(client *c, const struct sockaddr_un *address)
{
    while (connect(c->fd, (const struct sockaddr *)address, sizeof *address) != 0)
        if (!client_wait(errno))
            return errno;
    return 0;
}

/* Returns 0 or an errno. */
static int client_connect(client *c, const struct sockaddr_un *address)
{
    c->fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (c->fd >= 0)
        set_patience(c->fd);
    return c->fd < 0 ? errno : client_connect_to(c, address);
}

/* ---- By the name of the bus ------------------------------------------------------------------ */

typedef enum named { NAMED_NONE, NAMED_ONE, NAMED_DOUBTFUL } named;

static void say_nothing(const char *text)
{
    (void)text;
}

/* Returns the reply of the bus whose control socket is at a path, or NULL. */
static json_t *ask_at(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    client c = {.bus = path};
    (void)snprintf(address.sun_path, sizeof address.sun_path, "%s", path);
    failure = client_connect(&c, &address);
    json_t *reply = failure == 0 ? client_ask(&c, client_request("status")) : NULL;
    client_close(&c);
    return reply;
}

/* Returns the status of the bus whose control socket is at a path, or NULL. It says nothing, and
 * leaves in `failure` why it does not know. */
static json_t *peek(const char *path)
{
    void (*const before)(const char *text) = teller;
    const int patience_s = reply_patience_s;
    const uint64_t wait = wait_ns;
    teller = say_nothing;
    reply_patience_s = NAME_PATIENCE_S;
    wait_ns = 0;
    json_t *reply = ask_at(path);
    teller = before;
    reply_patience_s = patience_s;
    wait_ns = wait;
    json_t *status = json_incref(json_object_get(reply, "status"));
    json_decref(reply);
    return status;
}

/* Returns true for the file of a bus or of its rig. The name may be without its end, or be a path
 * to it. */
static bool is_file_of(const json_t *status, const char *key, const char *name)
{
    char *file = client_file_of(status, key);
    struct stat one, other;
    const char *slash = file ? strrchr(file, '/') : NULL;
    const char *own = slash ? slash + 1 : "";
    const size_t length = strlen(name);
    const bool same = !is_path(name) && strncmp(own, name, length) == 0 &&
                      (own[length] == '\0' || strcmp(own + length, ".yaml") == 0);
    const bool found = same || (file && stat(name, &one) == 0 && stat(file, &other) == 0 &&
                                one.st_dev == other.st_dev && one.st_ino == other.st_ino);
    free(file);
    return found;
}

/* Returns true for one more name of a socket. */
static bool is_link(const char *path)
{
    struct stat found;
    return lstat(path, &found) == 0 && S_ISLNK(found.st_mode);
}

/* One of several, or one beside a bus that hangs and may be the one that is meant. */
static void complain_of_several(const char *bus, const char *sockets)
{
    const client c = {.bus = bus};
    if (strchr(sockets, ','))
        client_complain(&c, "several buses have this name; take one of their sockets in %s: %s",
                        buses_folder(), sockets);
    else
        client_complain(&c, "%s has this name, and maybe one that does not answer; take one of "
                        "their sockets in %s: %s, %s", sockets, buses_folder(), sockets, silent);
}

/* Looks if the bus at a socket has a name, or its configuration. */
static bool is_named(const char *path, const char *name, const char *bus)
{
    json_t *status = peek(path);
    const char *own = get_text(json_object_get(status, "bus"), "name");
    const bool same = own && strcmp(own, bus) == 0;
    if (failure == EAGAIN)
        add_name(silent, name);
    if (failure == EACCES)
        add_name(closed, name);
    if (is_file_of(status, "file", bus) || is_file_of(status, "rig", bus))
        add_name(configured, name);
    json_decref(status);
    return same;
}

/* Looks at all buses that run; those with that name are added to `same`. */
static void look_for_name(struct sockaddr_un *address, char same[NAMES_BYTES], const char *bus)
{
    char *names[BUSES_MAX];
    silent[0] = closed[0] = configured[0] = '\0';
    const size_t count = buses_find(names, BUSES_MAX, true);
    for (size_t i = 0; i < count; i++) {
        char *path = buses_path(names[i]);
        if (path && strlen(path) < sizeof address->sun_path && !is_link(path) &&
            is_named(path, names[i], bus)) {
            add_name(same, names[i]);
            memcpy(address->sun_path, path, strlen(path) + 1);
        }
        free(path);
        free(names[i]);
    }
}

/* Finds the bus that runs with that name, when no socket has it: a unit and its bus may have
 * different names. Complains of several, and when another bus may have it, too. */
static named find_named(struct sockaddr_un *address, const char *bus)
{
    char text[NAMES_BYTES] = "";
    if (is_path(bus) || client_has_socket(bus))
        return NAMED_NONE;
    look_for_name(address, text, bus);
    if (!*text)
        return NAMED_NONE;
    if (!strchr(text, ',') && (!*silent || allow_doubt))
        return NAMED_ONE;
    complain_of_several(bus, text);
    return NAMED_DOUBTFUL;
}

/* Returns true for a file that is no socket, after saying whose configuration it is. */
static bool complain_of_file(const client *c, const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    char text[NAMES_BYTES] = "";
    struct stat found;
    if (stat(path, &found) != 0 || !S_ISREG(found.st_mode))
        return false;
    look_for_name(&address, text, path);
    if (*configured)
        client_complain(c, "that is a configuration; its buses in %s: %s", buses_folder(),
                        configured);
    else
        client_complain(c, "that is a file, and no socket of a bus");
    return true;
}

bool client_is_named(const char *bus)
{
    void (*const before)(const char *text) = teller;
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    teller = say_nothing;
    const named found = find_named(&address, bus);
    teller = before;
    return found != NAMED_NONE;
}

bool client_open(client *c, const char *bus)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    *c = (client){.bus = bus, .fd = -1};
    if (!find_socket(&address, bus)) {
        client_complain(c, "the path of its socket is too long");
        return false;
    }
    const named found = find_named(&address, bus);
    if (found == NAMED_DOUBTFUL)
        return false;
    int error = client_connect(c, &address);
    if (error == ENOENT) { /* it may have started meanwhile */
        client_close(c);
        const named later = find_named(&address, bus);
        if (later == NAMED_DOUBTFUL)
            return false;
        error = later == NAMED_ONE ? client_connect(c, &address) : error;
    }
    passed_over = pass_over && error == EPROTOTYPE;
    if (error != 0) {
        if (!passed_over && !complain_of_file(c, address.sun_path))
            complain_unreachable(c, address.sun_path, error);
        client_close(c);
        return false;
    }
    return true;
}

void client_close(client *c)
{
    if (c->fd >= 0)
        (void)close(c->fd);
    lines_free(&c->in);
    *c = (client){.bus = c->bus, .fd = -1};
}

/* ---- Asking ---------------------------------------------------------------------------------- */

/* Sends a text. A connection that the bus has closed is not an error here, since its reply has the
 * reason. */
static bool send_all(const client *c, const char *text, size_t length, int64_t until)
{
    for (size_t sent = 0; sent < length;) {
        ssize_t count = -1;
        if (lines_wait(c->fd, POLLOUT, until))
            count = send(c->fd, text + sent, length - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
        else if (errno == EAGAIN)
            errno = ETIMEDOUT;
        if (count < 0 && errno == EPIPE)
            return true;
        if (count < 0 && errno != EINTR && errno != EAGAIN) {
            failure = errno == ETIMEDOUT ? EAGAIN : errno;
            client_complain(c, "%s",
                            failure == EAGAIN ? "it does not take requests" : strerror(failure));
            return false;
        }
        sent += count > 0 ? (size_t)count : 0;
    }
    return true;
}

/* A request is one line of JSON. */
static bool send_request(const client *c, const json_t *request, int64_t until)
{
    char *text = json_dumps(request, JSON_COMPACT);
    bool good = text && send_all(c, text, strlen(text), until) &&
                send_all(c, "\n", 1, until);
    free(text);
    return good;
}

/* Makes a text plain. Returns it when that changes it, else NULL; to be freed. */
static char *cleaned(const char *text)
{
    char *copy = strdup(text);
    if (copy)
        plain_make(copy, '?');
    if (copy && strcmp(copy, text) != 0)
        return copy;
    free(copy);
    return NULL;
}

/* Makes keys plain, and adds the members to those that are to be cleaned. */
static void clean_members(json_t *object, json_t *rest)
{
    void *next;
    const char *key;
    json_t *value;
    json_object_foreach_safe(object, next, key, value) {
        char *plain = cleaned(key);
        (void)json_array_append(rest, value);
        if (plain && json_object_set(object, plain, value) == 0)
            (void)json_object_del(object, key);
        free(plain);
    }
}

/* Cleans a text of control characters, which could act on the terminal. Lists and objects are put
 * off: depth costs no stack. */
static void clean_one(json_t *value, json_t *rest)
{
    if (json_is_string(value)) {
        char *plain = cleaned(json_string_value(value));
        if (plain)
            (void)json_string_set(value, plain);
        free(plain);
    }
    if (json_is_array(value))
        (void)json_array_extend(rest, value);
    if (json_is_object(value))
        clean_members(value, rest);
}

/* Makes all texts of a value plain: in JSON a control character may be written as \u001b. */
static void clean(json_t *value)
{
    json_t *rest = json_array();
    (void)json_array_append(rest, value);
    for (size_t i = 0; i < json_array_size(rest); i++)
        clean_one(json_array_get(rest, i), rest);
    json_decref(rest);
}

json_t *client_parse(const char *line, json_error_t *error)
{
    json_t *value = json_loads(line, 0, error);
    clean(value);
    return value;
}

const char *client_next(client *c)
{
    char *line = lines_next(&c->in, c->fd, LINES_NO_END);
    c->error = line ? 0 : errno;
    if (line)
        plain_make_lines(line, '?');
    return line;
}

bool client_report_end(const client *c)
{
    if (c->error == 0)
        client_complain(c, "it has ended");
    else
        client_complain(c, "it cannot be read any more: %s", strerror(c->error));
    return c->error == 0;
}

/* Prints a refusal. Messages of the loader stand alone: they name file, line and column. */
static void print_refusal(const client *c, const json_t *reply)
{
    const json_t *errors = json_object_get(reply, "errors");
    const char *error = get_text(reply, "error");
    for (size_t i = 0; i < json_array_size(errors); i++) {
        const char *text = json_string_value(json_array_get(errors, i));
        teller(text ? text : "?");
    }
    if (json_array_size(errors) == 0)
        client_complain(c, "%s", error ? error : "refused without a reason");
}

/* Returns true for a request that does more than to tell something. */
static bool is_order(const json_t *request)
{
    const char *name = get_any_text(request, "request");
    return strcmp(name, "status") != 0 && strcmp(name, "faults") != 0 && strcmp(name, "watch") != 0;
}

/* Returns why no reply has come. An order may still be carried out: nobody knows. */
static const char *why_no_reply(int number, bool order)
{
    if (number == EAGAIN)
        return order ? "it does not answer; what was asked may yet be done" : "it does not answer";
    if (number == EMSGSIZE)
        return "what it answers is too long";
    return number == ENOMEM ? "out of memory" : "it ended the connection";
}

/* Reads a reply. Returns NULL after a message, also when the bus refuses. */
static json_t *read_reply(client *c, int64_t until)
{
    const char *line = lines_next(&c->in, c->fd, until);
    const int number = errno;
    json_error_t error = {.text = ""};
    failure = line ? 0 : number;
    json_t *reply = line ? json_loads(line, 0, &error) : NULL;
    if (!c->exact || !json_is_true(json_object_get(reply, "ok")))
        clean(reply);
    if (!line)
        client_complain(c, "%s", why_no_reply(number, c->order));
    else if (!json_is_object(reply))
        client_complain(c, "what it answers is no JSON object%s%s", *error.text ? ": " : "",
                        error.text);
    else if (json_is_true(json_object_get(reply, "ok")))
        return reply;
    else
        print_refusal(c, reply);
    json_decref(reply);
    return NULL;
}

json_t *client_ask(client *c, json_t *request)
{
    const int64_t until = end_of_patience();
    c->order = is_order(request);
    bool sent = send_request(c, request, until);
    json_decref(request);
    return sent ? read_reply(c, until) : NULL;
}

/* Asks a question by a connection of its own. Takes the request. */
static json_t *ask_once(const char *bus, json_t *request, bool exact)
{
    client c;
    json_t *reply = NULL;
    if (client_open(&c, bus)) {
        c.exact = exact;
        reply = client_ask(&c, request);
        client_close(&c);
    } else {
        json_decref(request);
    }
    return reply;
}

json_t *client_ask_once(const char *bus, json_t *request)
{
    return ask_once(bus, request, false);
}

json_t *client_ask_exact(const char *bus, json_t *request)
{
    return ask_once(bus, request, true);
}

/* Connects and sends. Returns false after a message, or for a socket of another type. */
static bool begin_to_ask(client *c, const char *path, const json_t *request)
{
    if (!client_open(c, path))
        return false;
    if (send_request(c, request, end_of_patience()))
        return true;
    client_close(c);
    return false;
}

bool client_ask_all(char *const *paths, size_t count, json_t *request, client_take *take,
                    void *user)
{
    client *all = calloc(count + 1, sizeof *all);
    const bool good = all;
    if (!good)
        teller("canwire: out of memory");
    all_until = end_of_patience();
    pass_over = true;
    for (size_t i = 0; good && i < count; i++) {
        passed_over = false;
        if (!begin_to_ask(&all[i], paths[i], request) && !passed_over)
            take(user, paths[i], NULL);
    }
    pass_over = false;
    for (size_t i = 0; good && i < count; i++) {
        if (all[i].fd >= 0)
            take(user, paths[i], read_reply(&all[i], end_of_patience()));
        client_close(&all[i]);
    }
    all_until = 0;
    free(all);
    json_decref(request);
    return good;
}

int client_report(const char *bus, json_t *request)
{
    json_t *reply = client_ask_once(bus, request);
    int status = reply ? CLI_OK : CLI_BAD_INPUT;
    json_decref(reply);
    return status;
}

json_t *client_request(const char *name)
{
    json_t *request = json_object();
    put_text(request, "request", name);
    return request;
}

char *client_path_in(const char *folder, const char *file)
{
    char *path = NULL;
    while (strncmp(file, "./", 2) == 0)
        file += 2;
    const int length = *file == '/' ? asprintf(&path, "%s", file)
                       : folder     ? asprintf(&path, "%s/%s", folder, file)
                                    : -1;
    return length < 0 ? NULL : path;
}

char *client_file_of(const json_t *status, const char *key)
{
    const char *file = get_text(status, key);
    const char *folder = get_text(status, "directory");
    return file ? client_path_in(folder, file) : NULL;
}
