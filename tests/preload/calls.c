/* SPDX-License-Identifier: MIT
 *
 * calls.c - makes the calls of SocketCAN and prints what comes of them.
 *
 * It knows nothing of canwire. It runs on a real vcan, and preloaded with the library: the output
 * must be that of calls.expected both times. calls INTERFACE
 */
#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/bcm.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <linux/net_tstamp.h>
#include <linux/sockios.h>
#include <net/if.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static const char *name;
static int interface;

static const char *error_of(long result)
{
    return result < 0 ? strerrorname_np(errno) : "ok";
}

#define SHOW(call)                                                                                 \
    do {                                                                                           \
        errno = 0;                                                                                 \
        const long r_ = (long)(call);                                                              \
        printf("%-60s %s\n", #call, error_of(r_));                                                 \
    } while (0)

#define NUMBER(call)                                                                               \
    do {                                                                                           \
        errno = 0;                                                                                 \
        const long r_ = (long)(call);                                                              \
        printf("%-60s %ld %s\n", #call, r_, error_of(r_));                                         \
    } while (0)

static time_t now_s(void)
{
    return time(NULL);
}

static void title(const char *text)
{
    printf("-- %s\n", text);
    (void)fflush(stdout);
}

static struct sockaddr_can address(int index)
{
    return (struct sockaddr_can){.can_family = AF_CAN, .can_ifindex = index};
}

static int bound(int index)
{
    const int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    const struct sockaddr_can a = address(index);
    if (fd < 0 || bind(fd, (const struct sockaddr *)&a, sizeof a) != 0) {
        perror("bind");
        exit(1);
    }
    return fd;
}

static struct can_frame frame(canid_t id, unsigned char first)
{
    return (struct can_frame){.can_id = id, .len = 2, .data = {first, 0x55}};
}

static void put(int fd, canid_t id, unsigned char first)
{
    const struct can_frame f = frame(id, first);
    if (write(fd, &f, sizeof f) != sizeof f)
        perror("write");
}

static void show(const char *what, const struct can_frame *f, ssize_t size)
{
    printf("%s: %zd: %X [%u] %02X %02X\n", what, size, f->can_id, f->len, f->data[0], f->data[1]);
}

/* Receives one frame, however long that takes. */
static void get(const char *what, int fd)
{
    struct can_frame f = {.can_id = 0};
    const ssize_t size = read(fd, &f, sizeof f);
    if (size < 0)
        printf("%s: %s\n", what, strerrorname_np(errno));
    else
        show(what, &f, size);
}

static void set(int fd, int option, int value)
{
    if (setsockopt(fd, SOL_CAN_RAW, option, &value, sizeof value) != 0)
        perror("setsockopt");
}

static int got(int fd, int level, int option)
{
    int value = -1;
    socklen_t size = sizeof value;
    return getsockopt(fd, level, option, &value, &size) == 0 ? value : -errno;
}

/* ---- Sockets --------------------------------------------------------------------------------- */

static void making(void)
{
    title("making and binding");
    SHOW(socket(PF_CAN, SOCK_RAW, 99));
    SHOW(socket(PF_CAN, SOCK_DGRAM, CAN_RAW));
    SHOW(socket(PF_CAN, SOCK_RAW, CAN_BCM));
    const int fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW);
    struct sockaddr_can a = address(interface), b = address(interface + 12345);
    struct sockaddr_can told;
    socklen_t size = sizeof told;
    const struct can_frame f = frame(1, 2);
    NUMBER(fcntl(fd, F_GETFD) & FD_CLOEXEC);
    NUMBER((fcntl(fd, F_GETFL) & O_NONBLOCK) != 0);
    NUMBER(got(fd, SOL_SOCKET, SO_DOMAIN));
    NUMBER(got(fd, SOL_SOCKET, SO_TYPE));
    NUMBER(got(fd, SOL_SOCKET, SO_PROTOCOL));
    SHOW(write(fd, &f, sizeof f));
    SHOW(bind(fd, (struct sockaddr *)&a, 4));
    SHOW(bind(fd, (struct sockaddr *)&b, sizeof b));
    a.can_family = AF_INET;
    SHOW(bind(fd, (struct sockaddr *)&a, sizeof a));
    a.can_family = AF_CAN;
    SHOW(bind(fd, (struct sockaddr *)&a, 8));
    SHOW(bind(fd, (struct sockaddr *)&a, sizeof a));
    SHOW(getsockname(fd, (struct sockaddr *)&told, &size));
    NUMBER(size);
    NUMBER(told.can_family == AF_CAN && told.can_ifindex == interface);
    size = sizeof told;
    SHOW(getpeername(fd, (struct sockaddr *)&told, &size));
    SHOW(connect(fd, (struct sockaddr *)&a, sizeof a));
    SHOW(listen(fd, 1));
    SHOW(shutdown(fd, SHUT_RD));
    SHOW(recv(fd, &told, sizeof told, 0));
    SHOW(close(fd));
    SHOW(close(fd));
}

static void interfaces(void)
{
    char text[IF_NAMESIZE] = "";
    struct ifreq r = {.ifr_name = ""};
    const int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    title("interfaces");
    NUMBER((int)if_nametoindex(name) == interface);
    NUMBER(if_indextoname((unsigned)interface, text) && strcmp(text, name) == 0);
    NUMBER(if_nametoindex("no-such"));
    (void)snprintf(r.ifr_name, sizeof r.ifr_name, "%s", name);
    SHOW(ioctl(fd, SIOCGIFINDEX, &r));
    NUMBER(r.ifr_ifindex == interface);
    SHOW(ioctl(fd, SIOCGIFMTU, &r));
    NUMBER(r.ifr_mtu);
    SHOW(ioctl(fd, SIOCGIFFLAGS, &r));
    NUMBER((r.ifr_flags & (IFF_UP | IFF_RUNNING)) == (IFF_UP | IFF_RUNNING));
    r.ifr_ifindex = interface;
    r.ifr_name[0] = '\0';
    SHOW(ioctl(fd, SIOCGIFNAME, &r));
    NUMBER(strcmp(r.ifr_name, name));
    (void)snprintf(r.ifr_name, sizeof r.ifr_name, "no-such");
    SHOW(ioctl(fd, SIOCGIFINDEX, &r));
    (void)close(fd);
}

/* ---- Options --------------------------------------------------------------------------------- */

static void options(void)
{
    struct can_filter filters[3] = {{0x123, 0x7FF}, {0x200, 0x700}, {0, 0}};
    const int fd = bound(interface);
    socklen_t size = sizeof filters;
    int one = 1;
    long long big = 1;
    title("options");
    for (int option = CAN_RAW_ERR_FILTER; option <= CAN_RAW_JOIN_FILTERS; option++)
        NUMBER(got(fd, SOL_CAN_RAW, option));
    NUMBER(got(fd, SOL_CAN_RAW, 99));
    NUMBER(got(fd, SOL_CAN_BASE, 1));
    SHOW(getsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, &size));
    NUMBER(size);
    NUMBER(filters[0].can_id | filters[0].can_mask);
    filters[0] = (struct can_filter){0x123, 0x7FF};
    SHOW(setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, sizeof filters - 1));
    SHOW(setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, 2 * sizeof *filters));
    size = 8;
    SHOW(getsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, &size));
    size = sizeof filters;
    SHOW(getsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, &size));
    NUMBER(size);
    NUMBER(filters[1].can_id);
    SHOW(setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, NULL, 0));
    size = sizeof filters;
    SHOW(getsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, filters, &size));
    NUMBER(size);
    SHOW(setsockopt(fd, SOL_CAN_RAW, CAN_RAW_LOOPBACK, &one, 2));
    SHOW(setsockopt(fd, SOL_CAN_RAW, CAN_RAW_LOOPBACK, &big, sizeof big));
    SHOW(setsockopt(fd, SOL_CAN_RAW, 99, &one, sizeof one));
    SHOW(setsockopt(fd, SOL_CAN_BASE, 1, &one, sizeof one));
    set(fd, CAN_RAW_ERR_FILTER, -1);
    NUMBER(got(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER) == CAN_ERR_MASK);
    set(fd, CAN_RAW_RECV_OWN_MSGS, 1);
    NUMBER(got(fd, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS));
    SHOW(setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPNS, &one, sizeof one));
    NUMBER(got(fd, SOL_SOCKET, SO_TIMESTAMPNS));
    NUMBER(got(fd, SOL_SOCKET, SO_TIMESTAMP));
    NUMBER(got(fd, SOL_SOCKET, SO_RXQ_OVFL));
    (void)close(fd);
}

static void filters(int a, int b)
{
    struct can_filter some[] = {{0x120, 0x7F0}, {0x125 | CAN_INV_FILTER, 0x7FF}};
    const struct can_filter all = {0, 0}, seven = {0x126, 0x7FF};
    title("filters");
    (void)setsockopt(b, SOL_CAN_RAW, CAN_RAW_FILTER, some, sizeof *some);
    put(a, 0x7FF, 1);
    put(a, 0x80000121, 2);
    put(a, 0x125, 3);
    get("one filter", b);
    get("one filter", b);
    set(b, CAN_RAW_JOIN_FILTERS, 1);
    (void)setsockopt(b, SOL_CAN_RAW, CAN_RAW_FILTER, some, sizeof some);
    put(a, 0x125, 4);
    put(a, 0x7FF, 5);
    put(a, 0x126, 6);
    get("joined", b);
    set(b, CAN_RAW_JOIN_FILTERS, 0);
    (void)setsockopt(b, SOL_CAN_RAW, CAN_RAW_FILTER, NULL, 0);
    const int c = bound(interface);
    (void)setsockopt(c, SOL_CAN_RAW, CAN_RAW_FILTER, &seven, sizeof seven);
    put(a, 0x126, 7);
    get("another socket", c); /* b has been passed over by now */
    (void)setsockopt(b, SOL_CAN_RAW, CAN_RAW_FILTER, &all, sizeof all);
    put(a, 0x127, 8);
    get("all again", b);
    (void)close(c);
}

/* ---- Frames ---------------------------------------------------------------------------------- */

/* Receives with all that may stand beside a frame. */
static void get_message(const char *what, int fd, int flags)
{
    struct can_frame f = {.can_id = 0};
    struct sockaddr_can from = {.can_family = 0};
    union {
        char bytes[512];
        struct cmsghdr align;
    } control;
    struct iovec part = {.iov_base = &f, .iov_len = sizeof f};
    struct msghdr m = {.msg_iov = &part,
                       .msg_iovlen = 1,
                       .msg_name = &from,
                       .msg_namelen = sizeof from,
                       .msg_control = &control,
                       .msg_controllen = sizeof control};
    const ssize_t size = recvmsg(fd, &m, flags);
    if (size < 0) {
        printf("%s: %s\n", what, strerrorname_np(errno));
        return;
    }
    show(what, &f, size);
    printf("  flags %s%s%s from %s, %u bytes, control %zu:",
           m.msg_flags & MSG_DONTROUTE ? "L" : "-", m.msg_flags & MSG_CONFIRM ? "C" : "-",
           m.msg_flags & MSG_TRUNC ? "T" : "-",
           from.can_ifindex == interface && from.can_family == AF_CAN ? "it" : "other",
           m.msg_namelen, (size_t)m.msg_controllen);
    for (struct cmsghdr *c = CMSG_FIRSTHDR(&m); c; c = CMSG_NXTHDR(&m, c)) {
        struct timespec time = {.tv_sec = 0};
        memcpy(&time, CMSG_DATA(c), sizeof time);
        printf(" type %d, %zu bytes, %s", c->cmsg_type, (size_t)c->cmsg_len,
               labs(time.tv_sec - (long)now_s()) < 1000 ? "now" : "never");
    }
    printf("\n");
}

static void messages(int a, int b)
{
    struct timeval stamp = {.tv_sec = 0};
    struct timespec nano = {.tv_sec = 0};
    int on = 1, off = 0;
    int timestamping = SOF_TIMESTAMPING_SOFTWARE | SOF_TIMESTAMPING_RX_SOFTWARE;
    title("messages");
    put(a, 0x101, 1);
    get_message("plain", b, 0);
    set(a, CAN_RAW_RECV_OWN_MSGS, 1);
    put(a, 0x102, 2);
    get_message("other", b, 0);
    get_message("own", a, 0);
    set(a, CAN_RAW_RECV_OWN_MSGS, 0);
    (void)setsockopt(b, SOL_SOCKET, SO_TIMESTAMP, &on, sizeof on);
    put(a, 0x103, 3);
    get_message("timestamp", b, 0);
    (void)setsockopt(b, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
    put(a, 0x104, 4);
    get_message("timestampns", b, 0);
    (void)setsockopt(b, SOL_SOCKET, SO_TIMESTAMPNS, &off, sizeof off);
    (void)setsockopt(b, SOL_SOCKET, SO_TIMESTAMPING, &timestamping, sizeof timestamping);
    put(a, 0x105, 5);
    get_message("timestamping", b, 0);
    (void)setsockopt(b, SOL_SOCKET, SO_TIMESTAMPING, &off, sizeof off);
    SHOW(ioctl(b, SIOCGSTAMP, &stamp));
    NUMBER(labs(stamp.tv_sec - (long)now_s()) < 1000);
    SHOW(ioctl(b, SIOCGSTAMPNS, &nano));
    NUMBER(labs(nano.tv_sec - (long)now_s()) < 1000);
}

static void sizes(int a, int b)
{
    struct can_frame f = frame(0x110, 1);
    struct canfd_frame fd = {.can_id = 0x111, .len = 12, .data = {1, 2}};
    unsigned char bytes[100];
    struct iovec parts[] = {{&f, 6}, {(char *)&f + 6, sizeof f - 6}};
    struct iovec into[] = {{bytes, 4}, {bytes + 10, 12}};
    title("sizes");
    SHOW(send(a, &f, 15, 0));
    SHOW(send(a, &fd, sizeof fd, 0));
    SHOW(send(a, bytes, sizeof bytes, 0));
    f.len = 9;
    SHOW(send(a, &f, sizeof f, 0));
    f.len = 2;
    NUMBER(writev(a, parts, 2));
    NUMBER(readv(b, into, 2));
    NUMBER(memcmp(bytes, &f, 4) | memcmp(bytes + 10, (char *)&f + 4, 12));
    put(a, 0x112, 2);
    NUMBER(recv(b, bytes, 8, MSG_TRUNC));
    put(a, 0x113, 3);
    NUMBER(recv(b, bytes, 8, 0));
    put(a, 0x114, 4);
    get_message("peek", b, MSG_PEEK);
    NUMBER(recv(b, bytes, 4, MSG_PEEK));
    get_message("peeked", b, 0);
    SHOW(recv(b, bytes, sizeof bytes, MSG_DONTWAIT));
    SHOW(recv(b, bytes, sizeof bytes, MSG_ERRQUEUE));
}

static void fd_frames(int a, int b)
{
    struct canfd_frame f = {.can_id = 0x131, .len = 12, .flags = CANFD_BRS, .data = {1, 2}};
    unsigned char bytes[CANFD_MTU];
    title("CAN FD");
    set(a, CAN_RAW_FD_FRAMES, 1);
    NUMBER(send(a, &f, sizeof f, 0));
    put(a, 0x132, 1);
    get("without", b);
    set(b, CAN_RAW_FD_FRAMES, 1);
    NUMBER(send(a, &f, sizeof f, 0));
    NUMBER(recv(b, bytes, sizeof bytes, 0));
    memcpy(&f, bytes, sizeof f);
    printf("%X [%u] flags %u %02X\n", f.can_id, f.len, f.flags & (CANFD_BRS | CANFD_ESI),
           f.data[0]);
    put(a, 0x133, 1);
    NUMBER(recv(b, bytes, sizeof bytes, 0));
    f.len = 65;
    SHOW(send(a, &f, sizeof f, 0));
    set(a, CAN_RAW_FD_FRAMES, 0);
    set(b, CAN_RAW_FD_FRAMES, 0);
}

static void addresses(int a, int b)
{
    struct sockaddr_can to = address(interface), none = address(0), other = address(77777);
    const struct can_frame f = frame(0x140, 1);
    struct can_frame back;
    socklen_t size = sizeof to;
    const int all = bound(0);
    title("addresses");
    NUMBER(sendto(a, &f, sizeof f, 0, (struct sockaddr *)&to, sizeof to));
    SHOW(sendto(a, &f, sizeof f, 0, (struct sockaddr *)&other, sizeof other));
    SHOW(sendto(a, &f, sizeof f, 0, (struct sockaddr *)&none, sizeof none));
    SHOW(sendto(a, &f, sizeof f, 0, (struct sockaddr *)&to, 4));
    memset(&to, 0, sizeof to);
    NUMBER(recvfrom(b, &back, sizeof back, 0, (struct sockaddr *)&to, &size));
    NUMBER(size);
    NUMBER(to.can_ifindex == interface);
    get_message("all", all, 0);
    SHOW(write(all, &f, sizeof f));
    to = address(interface);
    NUMBER(sendto(all, &f, sizeof f, 0, (struct sockaddr *)&to, sizeof to));
    get("of all", b);
    SHOW(getsockname(all, (struct sockaddr *)&to, &size));
    NUMBER(to.can_ifindex);
    (void)close(all);
    get("to the other", a);
}

/* ---- Waiting --------------------------------------------------------------------------------- */

static void waiting(int a, int b)
{
    struct pollfd p = {.fd = b, .events = POLLIN};
    struct epoll_event event = {.events = EPOLLIN, .data.u32 = 42}, out = {.events = 0};
    struct timeval short_time = {.tv_usec = 20000};
    struct can_frame f;
    fd_set set_of;
    const int epoll = epoll_create1(0);
    title("waiting");
    NUMBER(poll(&p, 1, 0));
    NUMBER(setsockopt(b, SOL_SOCKET, SO_RCVTIMEO, &short_time, sizeof short_time));
    SHOW(recv(b, &f, sizeof f, 0));
    short_time.tv_usec = 0;
    NUMBER(setsockopt(b, SOL_SOCKET, SO_RCVTIMEO, &short_time, sizeof short_time));
    NUMBER(epoll_ctl(epoll, EPOLL_CTL_ADD, b, &event));
    NUMBER(epoll_wait(epoll, &out, 1, 0));
    put(a, 0x150, 1);
    NUMBER(epoll_wait(epoll, &out, 1, 30000));
    NUMBER(out.data.u32);
    NUMBER(poll(&p, 1, 30000));
    NUMBER(p.revents);
    FD_ZERO(&set_of);
    FD_SET(b, &set_of);
    NUMBER(select(b + 1, &set_of, NULL, NULL, NULL));
    get("after them", b);
    NUMBER(epoll_wait(epoll, &out, 1, 0));
    p = (struct pollfd){.fd = a, .events = POLLOUT};
    NUMBER(poll(&p, 1, 0));
    (void)close(epoll);
}

static void many(int a, int b)
{
    struct can_frame out[4], in[4];
    struct mmsghdr m[4];
    struct iovec parts[4];
    title("many at once");
    memset(m, 0, sizeof m);
    for (unsigned i = 0; i < 4; i++) {
        out[i] = frame(0x160 + i, (unsigned char)i);
        parts[i] = (struct iovec){.iov_base = &out[i], .iov_len = sizeof out[i]};
        m[i].msg_hdr.msg_iov = &parts[i];
        m[i].msg_hdr.msg_iovlen = 1;
    }
    NUMBER(sendmmsg(a, m, 4, 0));
    NUMBER(m[3].msg_len);
    for (unsigned i = 0; i < 4; i++)
        parts[i].iov_base = &in[i];
    NUMBER(recvmmsg(b, m, 3, 0, NULL));
    show("third", &in[2], m[2].msg_len);
    NUMBER(recvmmsg(b, m, 3, MSG_WAITFORONE, NULL));
    show("fourth", &in[0], m[0].msg_len);
    SHOW(recvmmsg(b, m, 3, MSG_DONTWAIT, NULL));
}

/* ---- Descriptors and processes --------------------------------------------------------------- */

static void copies(int a)
{
    const int b = bound(interface), c = dup(b), d = fcntl(b, F_DUPFD_CLOEXEC, 50);
    int own = bound(interface);
    title("copies");
    put(a, 0x170, 1);
    get("first of a copy", c);
    (void)close(b);
    put(a, 0x171, 2);
    get("the original is closed", d);
    NUMBER(dup2(c, own) == own);
    (void)close(c);
    put(a, 0x172, 3);
    get("dup2", own);
    NUMBER(got(own, SOL_SOCKET, SO_DOMAIN));
    SHOW(close_range((unsigned)d, (unsigned)d, 0));
    SHOW(read(d, &own, 1));
    put(own, 0x173, 4);
    get("from the copy", a);
    (void)close(own);
}

static void processes(int a, int b)
{
    int status = -1;
    title("processes");
    (void)fflush(stdout);
    pid_t child = fork();
    if (child == 0) {
        get("in the child", b);
        put(b, 0x181, 2);
        (void)fflush(stdout);
        _exit(7);
    }
    put(a, 0x180, 1);
    NUMBER(waitpid(child, &status, 0) == child);
    NUMBER(WEXITSTATUS(status));
    get("from the child", a);
    put(a, 0x182, 3);
    get("after it", b);
    child = vfork();
    if (child == 0) {
        (void)close(a);
        (void)close(b);
        _exit(0);
    }
    (void)waitpid(child, &status, 0);
    put(a, 0x183, 4);
    get("after vfork", b);
}

#define THREADS 4
#define EACH 25

static void *reading(void *user)
{
    long sum = 0;
    struct can_frame f;
    const int fd = *(int *)user;
    while (read(fd, &f, sizeof f) == sizeof f && f.can_id != 0x7F0)
        sum += f.data[0];
    return (void *)sum;
}

static void *writing(void *user)
{
    for (unsigned i = 0; i < EACH; i++)
        put(*(int *)user, 0x190, 1);
    return NULL;
}

static void threads(int a, int b)
{
    pthread_t writers[THREADS], reader;
    void *sum = NULL;
    title("threads");
    (void)pthread_create(&reader, NULL, reading, &b);
    for (int i = 0; i < THREADS; i++)
        (void)pthread_create(&writers[i], NULL, writing, &a);
    for (int i = 0; i < THREADS; i++)
        (void)pthread_join(writers[i], NULL);
    put(a, 0x7F0, 0);
    (void)pthread_join(reader, &sum);
    NUMBER(sum);
}

static volatile sig_atomic_t signals;
static int of_signals;

static void on_signal(int number)
{
    (void)number;
    const int error = errno;
    if (signals < 50)
        put(of_signals, 0x1A0, 1);
    signals++;
    errno = error;
}

/* A handler makes calls while the same calls are made: none waits for the other. */
static void handlers(int a, int b)
{
    const struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};
    const struct itimerval often = {.it_interval.tv_usec = 1000, .it_value.tv_usec = 1000};
    const struct itimerval never = {.it_value.tv_usec = 0};
    struct can_frame f;
    int found = 0;
    title("handlers of signals");
    of_signals = a;
    (void)sigaction(SIGALRM, &action, NULL);
    (void)setitimer(ITIMER_REAL, &often, NULL);
    while (found < 50) {
        put(a, 0x1A1, 2);
        if (read(b, &f, sizeof f) == sizeof f)
            found += f.can_id == 0x1A0;
    }
    (void)setitimer(ITIMER_REAL, &never, NULL);
    NUMBER(found);
    put(a, 0x1A2, 3);
    while (read(b, &f, sizeof f) == sizeof f && f.can_id != 0x1A2)
        continue;
}

/* ---- CAN_BCM --------------------------------------------------------------------------------- */

typedef struct job {
    struct bcm_msg_head head;
    struct can_frame frames[3];
} job;

static job job_of(unsigned opcode, canid_t id, unsigned flags, unsigned frames)
{
    job j = {.head = {.opcode = opcode, .flags = flags, .can_id = id, .nframes = frames}};
    for (unsigned i = 0; i < 3; i++)
        j.frames[i] = frame(id, (unsigned char)i);
    return j;
}

static size_t size_of(const job *j)
{
    return sizeof j->head + j->head.nframes * sizeof *j->frames;
}

static long order(int fd, const job *j)
{
    return write(fd, j, size_of(j));
}

static void told(const char *what, int fd)
{
    job j = {.head = {.opcode = 0}};
    struct sockaddr_can from = {.can_family = 0};
    socklen_t length = sizeof from;
    const ssize_t size = recvfrom(fd, &j, sizeof j, 0, (struct sockaddr *)&from, &length);
    printf("%s: %zd: opcode %u id %X flags %X count %u frames %u", what, size, j.head.opcode,
           j.head.can_id, j.head.flags, j.head.count, j.head.nframes);
    if (j.head.nframes > 0)
        printf(", %X [%u] %02X", j.frames[0].can_id, j.frames[0].len, j.frames[0].data[0]);
    printf(" from %s\n", from.can_ifindex == interface ? "it" : "other");
}

static void bcm_sending(int fd, int b)
{
    job j = job_of(TX_SETUP, 0x201, SETTIMER | STARTTIMER, 2);
    title("CAN_BCM, sending");
    j.head.count = 0;
    j.head.ival2 = (struct bcm_timeval){.tv_usec = 5000};
    NUMBER(order(fd, &j));
    get("cyclic", b);
    get("cyclic", b);
    get("cyclic", b);
    j = job_of(TX_READ, 0x201, 0, 0);
    NUMBER(order(fd, &j));
    told("read", fd);
    j = job_of(TX_SETUP, 0x201, 0, 3);
    SHOW(order(fd, &j));
    j = job_of(TX_DELETE, 0x201, 0, 0);
    NUMBER(order(fd, &j));
    SHOW(order(fd, &j));
    j = job_of(TX_READ, 0x201, 0, 0);
    SHOW(order(fd, &j));
    j = job_of(TX_SEND, 0x202, 0, 1);
    NUMBER(order(fd, &j));
    j = job_of(TX_SETUP, 0x203, SETTIMER | STARTTIMER | TX_COUNTEVT, 1);
    j.head.count = 3;
    j.head.ival1 = (struct bcm_timeval){.tv_usec = 2000};
    NUMBER(order(fd, &j));
    told("expired", fd);
    j = job_of(TX_DELETE, 0x203, 0, 0);
    NUMBER(order(fd, &j));
}

/* Reads frames of the cyclic job, of which some may have come before it was deleted. */
static void get_others(int b)
{
    struct can_frame f;
    int found = 0;
    while (found < 4 && read(b, &f, sizeof f) == sizeof f) {
        if (f.can_id == 0x201)
            continue;
        show("sent", &f, sizeof f);
        found++;
    }
}

static void bcm_receiving(int fd, int a)
{
    job j = job_of(RX_SETUP, 0x210, SETTIMER, 1);
    title("CAN_BCM, receiving");
    j.frames[0].data[0] = 0xFF;
    j.frames[0].data[1] = 0;
    NUMBER(order(fd, &j));
    put(a, 0x210, 1);
    told("first", fd);
    put(a, 0x210, 1);
    put(a, 0x211, 9);
    put(a, 0x210, 2);
    told("changed", fd);
    j = job_of(RX_READ, 0x210, 0, 0);
    NUMBER(order(fd, &j));
    told("status", fd);
    j = job_of(RX_SETUP, 0x211, RX_FILTER_ID | SETTIMER | STARTTIMER, 0);
    j.head.ival1 = (struct bcm_timeval){.tv_usec = 10000};
    NUMBER(order(fd, &j));
    told("timeout", fd);
    put(a, 0x211, 5);
    told("any", fd);
    told("timeout again", fd);
    j = job_of(RX_DELETE, 0x211, 0, 0);
    NUMBER(order(fd, &j));
    SHOW(order(fd, &j));
    j = job_of(RX_SETUP, 0x40000212, RX_RTR_FRAME, 1);
    j.frames[0] = frame(0x212, 0x77);
    NUMBER(order(fd, &j));
    put(a, 0x40000212, 0);
    get("answer", a);
    j = job_of(99, 1, 0, 0);
    SHOW(order(fd, &j));
    SHOW(write(fd, &j, 10));
    j = job_of(RX_SETUP, 0x213, SETTIMER, 1);
    j.head.ival1 = (struct bcm_timeval){.tv_usec = 1000000};
    SHOW(order(fd, &j));
}

static void bcm(int a, int b)
{
    const int fd = socket(PF_CAN, SOCK_DGRAM, CAN_BCM);
    struct sockaddr_can to = address(interface);
    job j = job_of(TX_SEND, 1, 0, 1);
    title("CAN_BCM");
    NUMBER(got(fd, SOL_SOCKET, SO_TYPE));
    SHOW(order(fd, &j));
    SHOW(bind(fd, (struct sockaddr *)&to, sizeof to));
    SHOW(connect(fd, (struct sockaddr *)&to, sizeof to));
    SHOW(connect(fd, (struct sockaddr *)&to, sizeof to));
    SHOW(recv(fd, &j, sizeof j, MSG_DONTWAIT));
    bcm_sending(fd, b);
    get_others(b);
    (void)close(b);
    (void)close(a);
    a = bound(interface);
    bcm_receiving(fd, a);
    SHOW(close(fd));
    (void)close(a);
}

/* Frames that a program writes with CAN_ERR_FLAG go to the other sockets of the interface. */
static void error_frames(void)
{
    const int a = bound(interface), b = bound(interface);
    const struct can_filter passive = {CAN_ERR_FLAG, CAN_ERR_FLAG | CAN_ERR_CRTL};
    title("error frames");
    set(a, CAN_RAW_RECV_OWN_MSGS, 1);
    set(a, CAN_RAW_ERR_FILTER, CAN_ERR_MASK);
    set(b, CAN_RAW_ERR_FILTER, CAN_ERR_BUSOFF);
    put(a, 0x108, 1);
    get_message("own", a, 0);
    put(a, CAN_ERR_FLAG | CAN_ERR_CRTL, 2);
    get_message("own error frame", a, 0);
    put(a, CAN_ERR_FLAG | CAN_ERR_BUSOFF | CAN_ERR_RESTARTED, 3);
    get_message("own error frame", a, 0);
    get_message("other", b, 0);
    get_message("other, of one class", b, 0);
    set(a, CAN_RAW_LOOPBACK, 0);
    put(a, CAN_ERR_FLAG | CAN_ERR_BUSOFF, 4);
    set(a, CAN_RAW_LOOPBACK, 1);
    (void)setsockopt(b, SOL_CAN_RAW, CAN_RAW_FILTER, &passive, sizeof passive);
    set(b, CAN_RAW_ERR_FILTER, 0);
    put(a, CAN_ERR_FLAG | CAN_ERR_ACK, 5);
    put(a, CAN_ERR_FLAG | CAN_ERR_CRTL, 6);
    get_message("by a filter", b, 0);
    (void)close(a);
    (void)close(b);
}

int main(int argc, char **argv)
{
    if (argc != 2)
        return 2;
    name = argv[1];
    interface = (int)if_nametoindex(name);
    if (interface == 0) {
        perror(name);
        return 1;
    }
    (void)setvbuf(stdout, NULL, _IOLBF, 0);
    making();
    interfaces();
    options();
    int a = bound(interface), b = bound(interface);
    filters(a, b);
    messages(a, b);
    sizes(a, b);
    fd_frames(a, b);
    (void)close(a);
    (void)close(b);
    error_frames();
    a = bound(interface);
    b = bound(interface);
    addresses(a, b);
    waiting(a, b);
    many(a, b);
    (void)close(b);
    copies(a);
    b = bound(interface);
    processes(a, b);
    threads(a, b);
    handlers(a, b);
    bcm(a, b);
    return 0;
}
