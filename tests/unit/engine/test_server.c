/* SPDX-License-Identifier: MIT
 *
 * test_server.c - the server of the control socket: its clients that mean harm, the places that
 * they share, the socket itself.
 */
#include "cases.h"
#include "control_rig.h"
#include "serve/requests.h"
#include "serve/server.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>

/* ---- What is done between two looks at the bus ----------------------------------------------- */

/* The clock of these tests advances by a step at each reading. So the number of readings is the
 * time, and nothing depends on the machine. */
#define STEP_S 0.001

#define WHERE "bus.yaml:2:10" /* of the control socket */

static struct {
    bool counts;
    ev_tstamp now;
    unsigned reads;
    size_t bytes;
    unsigned lines;
} work;

/* Replaces libev's function, and recv() of the C library, for the whole program. */
ev_tstamp ev_time(void)
{
    struct timespec t;
    if (work.counts)
        return work.now += STEP_S;
    (void)clock_gettime(CLOCK_REALTIME, &t);
    return (ev_tstamp)t.tv_sec + (ev_tstamp)t.tv_nsec * 1e-9;
}

ssize_t recv(int fd, void *out, size_t size, int flags)
{
    ssize_t count = recvfrom(fd, out, size, flags, NULL, NULL);
    if (flags & MSG_DONTWAIT) { /* the server's */
        work.reads++;
        work.bytes += count > 0 ? (size_t)count : 0;
    }
    return count;
}

/* Checks that the server still serves others. */
static void expect_service(const rig *r)
{
    int fd = connect_client(r);
    tell(r, fd, "{\"request\":\"faults\"}");
    close(fd);
    turns(r, 4);
}

/* ---- Clients that mean harm ------------------------------------------------------------------ */

CASE(requests_may_come_in_pieces_and_in_heaps)
{
    const rig *r = *state;
    int fd = connect_client(r);
    const char *request = "{\"request\":\"faults\"}\r\n";
    for (const char *c = request; *c; c++)
        assert_true(send_bytes(r, fd, c, 1));
    json_decref(next_json(r, fd));
    send_text(r, fd,
              "\n\n  \n{\"id\":1,\"request\":\"faults\"}\n{\"id\":2,\"request\":\"faults\"}\n\n");
    for (int id = 1; id <= 2; id++) {
        json_auto_t *reply = next_json(r, fd);
        assert_int_equal(number(reply, "id"), id);
    }
    close(fd);
}

CASE(replies_come_before_the_end)
{
    const rig *r = *state;
    int fd = connect_client(r);
    for (int i = 0; i < 100; i++)
        send_text(r, fd, "{\"request\":\"status\"}\n");
    send_text(r, fd, "{\"request\":\"cle"); /* half a request is none */
    shutdown(fd, SHUT_WR);
    for (int i = 0; i < 100; i++)
        json_decref(next_json(r, fd));
    assert_null(next_line(r, fd));
    close(fd);
}

CASE(half_lines_hold_up_nobody)
{
    const rig *r = *state;
    int fds[SERVER_USER_MAX - 1];
    for (unsigned i = 0; i < SERVER_USER_MAX - 1; i++) {
        fds[i] = connect_client(r);
        send_text(r, fds[i], "{\"request\":");
    }
    expect_service(r);
    for (unsigned i = 0; i < SERVER_USER_MAX - 1; i++) {
        send_text(r, fds[i], "\"faults\"}\n");
        json_decref(next_json(r, fds[i]));
        close(fds[i]);
    }
}

CASE(long_lines_end_the_connection)
{
    const rig *r = *state;
    int fd = connect_client(r);
    size_t length = SERVER_LINE_MAX + SERVER_LINE_MAX / 2;
    FREED char *line = malloc(length);
    memset(line, 'x', length);
    (void)send_bytes(r, fd, line, length); /* it may hang up on the way */
    assert_non_null(strstr(next_line(r, fd), "too long"));
    assert_null(next_line(r, fd));
    close(fd);
    expect_service(r);
}

CASE(noise_is_refused)
{
    const rig *r = *state;
    static char noise[REQUEST_BYTES_MAX];
    uint32_t random = 1;
    int fd = connect_client(r);
    for (size_t i = 0; i < sizeof noise; i++) {
        random = random * 1664525u + 1013904223u;
        noise[i] = (char)(random >> 24);
    }
    noise[sizeof noise - 1] = '\n';
    unsigned lines = 0;
    for (size_t begin = 0, i = 0; i < sizeof noise; i++) {
        if (noise[i] != '\n')
            continue;
        lines += strspn(noise + begin, " \t\r") < i - begin;
        begin = i + 1;
    }
    assert_true(send_bytes(r, fd, noise, sizeof noise));
    for (; lines > 0; lines--) {
        json_auto_t *reply = next_json(r, fd);
        assert_false(is_on(reply, "ok"));
    }
    tell(r, fd, "{\"request\":\"status\"}");
    close(fd);
}

CASE(readers_who_do_not_read_are_disconnected)
{
    const rig *r = *state;
    int fd = connect_client(r);
    bool alive = true;
    for (unsigned i = 0; alive && i < 20000; i++)
        alive = send_bytes(r, fd, "{\"request\":\"status\"}\n", 21);
    assert_false(alive);
    close(fd);
    expect_service(r);
}

CASE(one_too_many_is_told)
{
    const rig *r = *state;
    int fds[SERVER_USER_MAX];
    for (unsigned i = 0; i < SERVER_USER_MAX; i++) {
        fds[i] = connect_client(r);
        turn(r);
    }
    int fd = connect_client(r);
    assert_non_null(strstr(next_line(r, fd), "too many connections"));
    assert_null(next_line(r, fd));
    close(fd);
    close(fds[17]);
    turns(r, 4);
    expect_service(r); /* a place is free again */
    for (unsigned i = 0; i < SERVER_USER_MAX; i++)
        if (i != 17)
            close(fds[i]);
}

CASE(thousand_connections_do_no_harm)
{
    const rig *r = *state;
    static int fds[1000];
    struct rlimit limit = {.rlim_cur = 2048, .rlim_max = 4096};
    getrlimit(RLIMIT_NOFILE, &limit);
    limit.rlim_cur = limit.rlim_max < 4096 ? limit.rlim_max : 4096;
    setrlimit(RLIMIT_NOFILE, &limit);
    for (unsigned i = 0; i < 1000; i++) {
        fds[i] = try_to_connect(r);
        if (fds[i] >= 0)
            (void)send(fds[i], "{\"request\":\"status\"}\n{", 22, MSG_NOSIGNAL);
        if (i % 8 == 0)
            turn(r);
    }
    turns(r, 100);
    for (unsigned i = 0; i < 1000; i++)
        if (fds[i] >= 0)
            close(fds[i]);
    turns(r, 100);
    expect_service(r);
}

/* ---- Calls of a server ----------------------------------------------------------------------- */

static void nobody_called(void *user, server_client *client, char *line, size_t length)
{
    (void)user;
    (void)client;
    (void)line;
    (void)length;
}

static void nothing_drained(void *user, server_client *client)
{
    (void)user;
    (void)client;
}

static void nothing_closed(void *user, unsigned client)
{
    (void)user;
    (void)client;
}

static const server_calls no_calls = {nobody_called, nothing_drained, nothing_closed, "", "", ""};

/* ---- Places ---------------------------------------------------------------------------------- */

/* A server of its own, whose clock stands still, and which answers each line with itself. */
typedef struct hall {
    const rig *rig;
    rig place; /* its path, for connect_client() */
    server *server;
} hall;

static ev_tstamp hall_time_s;

static ev_tstamp read_hall_clock(struct ev_loop *loop)
{
    (void)loop;
    return hall_time_s;
}

static void keep_or_echo(void *user, server_client *client, char *line, size_t length)
{
    (void)user;
    work.lines++;
    if (strcmp(line, "keep") == 0)
        server_keep(client, true);
    line[length] = '\n';
    server_write(client, line, length + 1);
}

static const server_calls hall_calls = {keep_or_echo, nothing_drained, nothing_closed,
                                        "too many\n", "too quiet\n",   "too long\n"};

static void open_hall(hall *h, const rig *r)
{
    *h = (hall){.rig = r, .place = *r};
    snprintf(h->place.path, sizeof h->place.path, "%s/hall", r->folder);
    h->server = server_start(r->loop, h->place.path, WHERE, -1, &hall_calls, NULL);
    assert_non_null(h->server);
    hall_time_s = 1000.0;
    server_set_clock(h->server, read_hall_clock);
    assert_int_equal(chmod(r->folder, 0755), 0); /* other users come */
    assert_int_equal(chmod(h->place.path, 0666), 0);
}

static void close_hall(hall *h)
{
    server_stop(h->server);
}

/* Connects a client of this user, which is let in or refused before this returns. */
static int come(const hall *h, uid_t user)
{
    assert_int_equal(seteuid(user), 0);
    int fd = connect_client(&h->place);
    assert_int_equal(seteuid(0), 0);
    turns(h->rig, 4);
    return fd;
}

static void expect_line(const hall *h, int fd, const char *expected)
{
    const char *line = next_line(h->rig, fd);
    assert_non_null(line);
    assert_string_equal(line, expected);
}

/* Checks that the client is served. */
static void expect_echo(const hall *h, int fd)
{
    send_text(h->rig, fd, "hello\n");
    expect_line(h, fd, "hello");
}

static void expect_refused(const hall *h, uid_t user)
{
    int fd = come(h, user);
    expect_line(h, fd, "too many");
    assert_null(next_line(h->rig, fd));
    close(fd);
}

/* Fills places of this user; the clients are left open. */
static void fill(const hall *h, int *fds, unsigned count, uid_t user)
{
    for (unsigned i = 0; i < count; i++)
        fds[i] = come(h, user);
    expect_echo(h, fds[count - 1]);
}

static void close_all(const hall *h, const int *fds, unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        close(fds[i]);
    turns(h->rig, 4);
}

#define STRANGER 1234u
#define FRIEND 1235u
#define DAEMON_USER 1236u /* a user other than root */

static bool needs_root(void)
{
    if (geteuid() != 0)
        skip();
    return geteuid() == 0;
}

#define CROWD 32u
#define HEAP_BYTES (1u << 17) /* more than is read at once, and than a socket takes at once */
#define READ_BYTES 65536u     /* at one wake-up, of one client: as in control_server.c */

/* Sends as much as the socket takes. */
static void send_what_fits(int fd, const char *text, size_t *at)
{
    for (ssize_t count; (count = send(fd, text + *at, HEAP_BYTES - *at, MSG_NOSIGNAL)) > 0;)
        *at += (size_t)count;
}

/* Many clients send this text repeatedly; the function returns after so many handled lines, or
 * bytes read. No turn of the loop may do much. */
static void hold_up(hall *h, const char *text, unsigned lines, size_t bytes)
{
    int fds[CROWD];
    size_t at[CROWD] = {0};
    unsigned all_lines = 0, turns_left = PATIENCE_TURNS;
    size_t all_bytes = 0;
    for (unsigned i = 0; i < CROWD; i++) {
        fds[i] = connect_client(&h->place);
        turn(h->rig);
    }
    while ((all_lines < lines || all_bytes < bytes) && turns_left-- > 0) {
        char echo[READ_BYTES];
        for (unsigned i = 0; i < CROWD; i++) {
            send_what_fits(fds[i], text, &at[i]);
            while (recvfrom(fds[i], echo, sizeof echo, 0, NULL, NULL) > 0)
                continue;
        }
        work.counts = true;
        work.reads = work.lines = 0;
        work.bytes = 0;
        turn(h->rig);
        work.counts = false;
        all_lines += work.lines;
        all_bytes += work.bytes;
        assert_in_range(work.lines, 0, 3); /* the time of a turn, here two looks at the clock */
        assert_in_range(work.reads, 0, CROWD);
        assert_in_range(work.bytes, 0, CROWD * READ_BYTES);
    }
    assert_true(all_lines >= lines && all_bytes >= bytes);
    for (unsigned i = 0; i < CROWD; i++)
        close(fds[i]);
    turns(h->rig, 100);
}

/* Neither many clients nor much that one of them sends. */
CASE(a_crowd_makes_little_work_at_a_time)
{
    hall h;
    static char heap[HEAP_BYTES];
    open_hall(&h, *state);
    memset(heap, 'x', sizeof heap); /* a line without end */
    hold_up(&h, heap, 0, CROWD * sizeof heap);
    for (size_t i = 3; i < sizeof heap; i += 4)
        heap[i] = '\n';
    hold_up(&h, heap, 5000, 0);
    close_hall(&h);
}

CASE(one_user_has_a_part_of_the_places)
{
    hall h;
    int fds[SERVER_USER_MAX];
    int others[SERVER_CLIENTS_MAX - SERVER_USER_MAX - 1];
    if (!needs_root())
        return;
    open_hall(&h, *state);
    fill(&h, fds, SERVER_USER_MAX, STRANGER);
    expect_refused(&h, STRANGER);
    fill(&h, others, sizeof others / sizeof others[0], FRIEND);
    expect_refused(&h, FRIEND); /* the last place is root's */
    int root = come(&h, 0);
    expect_echo(&h, root);
    expect_refused(&h, 0); /* it has had its place */
    close(root);
    turns(h.rig, 4);
    expect_refused(&h, FRIEND); /* and has it again */
    close_all(&h, fds, 1);
    int friend = come(&h, FRIEND);
    expect_echo(&h, friend);
    close(friend);
    close_all(&h, fds + 1, SERVER_USER_MAX - 1);
    close_all(&h, others, sizeof others / sizeof others[0]);
    close_hall(&h);
}

/* The server finds the daemon's user when a client comes. */
static int come_to(const hall *h, uid_t user, uid_t daemon_user)
{
    assert_int_equal(seteuid(user), 0);
    int fd = connect_client(&h->place);
    assert_int_equal(seteuid(0), 0);
    assert_int_equal(seteuid(daemon_user), 0);
    turns(h->rig, 4);
    assert_int_equal(seteuid(0), 0);
    return fd;
}

CASE(one_place_is_for_root_and_one_for_its_own_user)
{
    hall h;
    int fds[SERVER_CLIENTS_MAX];
    unsigned count = 0;
    if (!needs_root())
        return;
    open_hall(&h, *state);
    for (; count < SERVER_CLIENTS_MAX - 2; count++)
        fds[count] = come_to(&h, STRANGER + 10 * (count % 2), DAEMON_USER);
    expect_echo(&h, fds[count - 1]);
    int refused = come_to(&h, FRIEND, DAEMON_USER);
    expect_line(&h, refused, "too many");
    close(refused);
    fds[count++] = come_to(&h, DAEMON_USER, DAEMON_USER);
    expect_echo(&h, fds[count - 1]);
    refused = come_to(&h, DAEMON_USER, DAEMON_USER); /* the other one is root's */
    expect_line(&h, refused, "too many");
    close(refused);
    fds[count++] = come_to(&h, 0, DAEMON_USER);
    expect_echo(&h, fds[count - 1]);
    close_all(&h, fds, count);
    close_hall(&h);
}

CASE(who_says_nothing_makes_room)
{
    hall h;
    int fds[SERVER_USER_MAX];
    if (!needs_root())
        return;
    open_hall(&h, *state);
    fill(&h, fds, SERVER_USER_MAX, STRANGER);
    hall_time_s += SERVER_IDLE_S - 1;
    send_text(h.rig, fds[1], "keep\n");
    expect_line(&h, fds[1], "keep");
    expect_refused(&h, STRANGER); /* none is quiet for long enough */
    hall_time_s += 0.5;
    expect_echo(&h, fds[0]); /* that one has spoken */
    hall_time_s += 0.5;
    int friend = come(&h, FRIEND); /* there is room: no client has to go */
    expect_echo(&h, friend);
    expect_echo(&h, fds[2]);
    int late = come(&h, STRANGER);
    expect_echo(&h, late);
    expect_line(&h, fds[3], "too quiet"); /* the first of those that were quiet for longest */
    assert_null(next_line(h.rig, fds[3]));
    hall_time_s += 10 * SERVER_IDLE_S;
    close(come(&h, STRANGER));
    expect_echo(&h, fds[1]); /* a watcher keeps its place */
    expect_echo(&h, friend); /* no client of others goes for it */
    close(late);
    close(friend);
    close_all(&h, fds, SERVER_USER_MAX);
    close_hall(&h);
}

#define STUFFING_MAX 400 /* lines that fill any socket, and are fewer than disconnect the client */

/* Lines that the client does not read come back, until its socket takes no more of them. */
static void stuff(const hall *h, int fd)
{
    static char line[2001];
    memset(line, 'x', sizeof line - 1);
    line[sizeof line - 1] = '\n';
    for (unsigned i = 0; i < STUFFING_MAX; i++) {
        assert_true(send_bytes(h->rig, fd, line, sizeof line));
        turns(h->rig, 2);
    }
}

/* Reads a part of what waits for it. */
static void read_some(const hall *h, int fd)
{
    static char bytes[65536];
    for (unsigned i = 0; i < 4; i++) {
        assert_true(recv(fd, bytes, sizeof bytes, MSG_DONTWAIT) > 0);
        turns(h->rig, 2);
    }
}

/* Reads on to the end of the connection, or until nothing more comes. Returns true at the end. */
static bool read_to_end(const hall *h, int fd)
{
    static char bytes[65536];
    for (unsigned idle = 0; idle < 10; idle++) {
        ssize_t count = recv(fd, bytes, sizeof bytes, MSG_DONTWAIT);
        if (count == 0 || (count < 0 && errno == ECONNRESET))
            return true;
        idle = count > 0 ? 0 : idle;
        turns(h->rig, 2);
    }
    return false;
}

CASE(who_does_not_read_makes_room)
{
    hall h;
    int fds[SERVER_USER_MAX];
    if (!needs_root())
        return;
    open_hall(&h, *state);
    fill(&h, fds, SERVER_USER_MAX, STRANGER);
    send_text(h.rig, fds[1], "keep\n");
    expect_line(&h, fds[1], "keep");
    stuff(&h, fds[0]);
    stuff(&h, fds[1]); /* one that watches */
    stuff(&h, fds[2]);
    hall_time_s += SERVER_IDLE_S - 1;
    for (unsigned i = 3; i < SERVER_USER_MAX; i++)
        expect_echo(&h, fds[i]);
    expect_refused(&h, STRANGER); /* none has been like that for long enough */
    read_some(&h, fds[2]);        /* slowly, but it does */
    hall_time_s += 1;
    int first = come(&h, STRANGER);
    int second = come(&h, STRANGER);
    expect_echo(&h, first);
    expect_echo(&h, second);
    expect_refused(&h, STRANGER);
    assert_true(read_to_end(&h, fds[0]));
    assert_true(read_to_end(&h, fds[1]));
    assert_false(read_to_end(&h, fds[2]));
    close(first);
    close(second);
    close_all(&h, fds, SERVER_USER_MAX);
    close_hall(&h);
}

/* ---- The socket itself ----------------------------------------------------------------------- */

CASE(the_socket_is_for_the_group)
{
    const rig *r = *state;
    struct stat found;
    assert_int_equal(stat(r->path, &found), 0);
    assert_true(S_ISSOCK(found.st_mode));
    assert_int_equal(found.st_mode & 07777, 0660);
}

CASE(a_live_socket_is_not_taken)
{
    const rig *r = *state;
    assert_null(server_start(r->loop, r->path, WHERE, -1, &no_calls, NULL));
    expect_service(r);
}

CASE(a_stale_socket_is_replaced)
{
    const rig *r = *state;
    char path[96];
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    snprintf(path, sizeof path, "%s/stale", r->folder);
    strcpy(address.sun_path, path);
    int fd = socket(AF_UNIX, SOCK_STREAM, 0);
    assert_int_equal(bind(fd, (struct sockaddr *)&address, sizeof address), 0);
    close(fd); /* as when a daemon was killed */
    server *s = server_start(r->loop, path, WHERE, -1, &no_calls, NULL);
    assert_non_null(s);
    server_stop(s);
    assert_int_equal(access(path, F_OK), -1);
}

CASE(other_files_are_left_alone)
{
    const rig *r = *state;
    char path[96];
    snprintf(path, sizeof path, "%s/file", r->folder);
    close(open(path, O_CREAT | O_WRONLY, 0600));
    assert_null(server_start(r->loop, path, WHERE, -1, &no_calls, NULL));
    assert_int_equal(unlink(path), 0);
    snprintf(path, sizeof path, "%s/no/folder", r->folder);
    assert_null(server_start(r->loop, path, WHERE, -1, &no_calls, NULL));
    memset(path, 'x', sizeof path - 1);
    assert_null(server_start(r->loop,
                             "/tmp/a-path-that-is-longer-than-the-hundred-and-seven-bytes-"
                             "that-the-kernel-takes-for-the-path-of-a-socket-of-a-bus",
                             WHERE, -1, &no_calls, NULL));
}

/* A socket that another program made at the same path stays. */
CASE(only_the_own_socket_is_removed)
{
    const rig *r = *state;
    char path[96];
    snprintf(path, sizeof path, "%s/mine", r->folder);
    server *first = server_start(r->loop, path, WHERE, -1, &no_calls, NULL);
    assert_non_null(first);
    assert_int_equal(unlink(path), 0);
    /* the path is the first one's */
    assert_null(server_start(r->loop, path, WHERE, -1, &no_calls, NULL));
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    strcpy(address.sun_path, path);
    int other = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    assert_int_equal(bind(other, (struct sockaddr *)&address, sizeof address), 0);
    server_stop(first);
    assert_int_equal(access(path, F_OK), 0);
    /* no daemon listens there */
    server *second = server_start(r->loop, path, WHERE, -1, &no_calls, NULL);
    assert_non_null(second);
    server_stop(second);
    assert_int_equal(access(path, F_OK), -1);
    close(other);
}
