/* SPDX-License-Identifier: MIT
 *
 * waits.c - a program that waits in one of the ways of C: waits WAY. It prints what it has seen
 * with the time, in ms since its begin. No line depends on the speed of the machine.
 */
#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/ioctl.h>
#include <sys/select.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static struct timespec begin;

/* Returns ms since the begin. */
static double now_ms(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)(now.tv_sec - begin.tv_sec) * 1e3 + (double)(now.tv_nsec - begin.tv_nsec) / 1e6;
}

static void tell(const char *what, long result)
{
    printf("%.3f %s %ld\n", now_ms(), what, result);
}

static int open_can(const char *name)
{
    struct sockaddr_can address = {.can_family = AF_CAN};
    const int fd = socket(PF_CAN, SOCK_RAW, CAN_RAW);
    address.can_ifindex = (int)if_nametoindex(name);
    if (fd < 0 || bind(fd, (struct sockaddr *)&address, sizeof address) != 0) {
        perror(name);
        exit(1);
    }
    return fd;
}

static void sleeps(int can)
{
    struct timespec span = {.tv_nsec = 5000000}, at = begin;
    (void)can;
    /* no wait: sleeping is what is tried */
    tell("nanosleep", nanosleep(&span, NULL));
    at.tv_sec += 1;
    tell("clock_nanosleep", clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &at, NULL));
    tell("usleep", usleep(250));
    tell("sleep", sleep(3600));
    tell("poll", poll(NULL, 0, 7));
    struct timeval limit = {.tv_usec = 3000};
    tell("select", select(0, NULL, NULL, NULL, &limit));
    clock_gettime(CLOCK_REALTIME, &span);
    struct timeval day;
    gettimeofday(&day, NULL);
    printf("%d %d %d\n", span.tv_sec == day.tv_sec, time(NULL) == day.tv_sec,
           span.tv_nsec / 1000 == day.tv_usec);
}

/* Another program sends a frame every 10 ms. */
static void receives(int can)
{
    struct can_frame frame;
    struct pollfd in = {.fd = can, .events = POLLIN};
    struct timeval limit = {.tv_usec = 4000};
    fd_set set;
    tell("poll", poll(&in, 1, -1));
    tell("read", read(can, &frame, sizeof frame));
    FD_ZERO(&set);
    FD_SET(can, &set);
    tell("select", select(can + 1, &set, NULL, NULL, &limit));
    tell("blocking read", read(can, &frame, sizeof frame));
    setsockopt(can, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    limit.tv_usec = 4000;
    setsockopt(can, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    tell("read with a limit", recv(can, &frame, sizeof frame, 0) < 0 ? -errno : 0);
    struct epoll_event event = {.events = EPOLLIN};
    const int all = epoll_create1(0);
    epoll_ctl(all, EPOLL_CTL_ADD, can, &event);
    tell("epoll_wait", epoll_wait(all, &event, 1, 2));
    tell("epoll_wait", epoll_wait(all, &event, 1, -1));
    tell("read", recv(can, &frame, sizeof frame, MSG_DONTWAIT));
    tell("read", recv(can, &frame, sizeof frame, MSG_DONTWAIT) < 0 ? -errno : 0);
}

static volatile sig_atomic_t rang;

static void on_alarm(int number)
{
    (void)number;
    rang++;
}

static void timers(int can)
{
    struct can_frame frame;
    uint64_t count = 0;
    const struct itimerspec every = {{.tv_nsec = 20000000}, {.tv_nsec = 30000000}};
    const int timer = timerfd_create(CLOCK_MONOTONIC, 0);
    const struct sigaction action = {.sa_handler = on_alarm};
    timerfd_settime(timer, 0, &every, NULL);
    tell("timerfd", read(timer, &count, sizeof count) == sizeof count ? (long)count : -1);
    /* no wait: virtual time goes on */
    usleep(50000);
    tell("timerfd", read(timer, &count, sizeof count) == sizeof count ? (long)count : -1);
    struct pollfd two[] = {{.fd = can, .events = POLLIN}, {.fd = timer, .events = POLLIN}};
    tell("poll", poll(two, 2, -1));
    close(timer);
    sigaction(SIGALRM, &action, NULL);
    alarm(2);
    tell("read", read(can, &frame, sizeof frame) < 0 ? -errno : 0);
    const struct itimerval often = {{.tv_usec = 1000}, {.tv_usec = 1000}};
    setitimer(ITIMER_REAL, &often, NULL);
    while (rang < 5)
        pause();
    tell("alarms", rang);
}

/* It never waits. */
static void spins(int can)
{
    (void)can;
    while (now_ms() < 50)
        continue;
    printf("over\n");
}

static void computes(int can)
{
    volatile unsigned sum = 0;
    (void)can;
    for (unsigned i = 0; i < 50000000; i++)
        sum += i;
    tell("computed", 0);
}

static void has_children(int can)
{
    int status;
    const pid_t child = fork();
    if (child == 0) {
        usleep(5000);
        struct can_frame frame = {.can_id = 0x55, .len = 0};
        _exit(write(can, &frame, sizeof frame) == sizeof frame ? 3 : 4);
    }
    /* no wait: virtual time goes on */
    usleep(1000);
    tell("slept", waitpid(child, &status, WNOHANG));
    tell("child", waitpid(child, &status, 0) == child ? WEXITSTATUS(status) : -1);
    tell("system", system("sleep 2"));
}

static void *run(void *nothing)
{
    return nothing;
}

static void makes_threads(int can)
{
    pthread_t thread;
    (void)can;
    tell("pthread_create", pthread_create(&thread, NULL, run, NULL) == EAGAIN);
}

static const struct {
    const char *name;
    void (*run)(int can);
} ways[] = {{"sleeps", sleeps},     {"receives", receives},         {"timers", timers},
            {"spins", spins},       {"computes", computes},         {"has_children", has_children},
            {"makes_threads", makes_threads}};

int main(int argc, char **argv)
{
    if (argc != 3)
        return 2;
    clock_gettime(CLOCK_MONOTONIC, &begin);
    const int can = open_can(argv[2]);
    setvbuf(stdout, NULL, _IOLBF, 0);
    for (size_t i = 0; i < sizeof ways / sizeof *ways; i++)
        if (strcmp(ways[i].name, argv[1]) == 0)
            ways[i].run(can);
    return 0;
}
