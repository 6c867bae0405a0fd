/* SPDX-License-Identifier: MIT
 *
 * links.c - finds, makes and removes network interfaces through rtnetlink.
 */
#include "port/links.h"

#include <errno.h>
#include <linux/can/vxcan.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#define REQUEST_BYTES 1024u /* more than the longest one needs */
#define REPLY_BYTES 65536u  /* the kernel sends no larger part of a dump */
#define ERROR_BYTES 200u

/* The indexes of peers in other namespaces, beyond those that a kernel gives by itself. */
#define INDEX_FIRST (1 << 20)
#define INDEX_TRIES 4096

struct links {
    int fd;
    uint32_t sequence;
    bool unanswered;
    char error[ERROR_BYTES];
    union {
        struct nlmsghdr header; /* for the alignment */
        char bytes[REPLY_BYTES];
    } reply;
};

typedef struct request {
    struct nlmsghdr header;
    struct ifinfomsg info;
    char attributes[REQUEST_BYTES];
} request;

/* The receiver of the messages that answer a request. */
typedef struct listener {
    links_visitor *visit;
    void *user;
    bool done; /* it needs no more messages */
} listener;

/* ---- Requests -------------------------------------------------------------------------------- */

/* Makes a request. The flags include the one that ends the answer: NLM_F_ACK or NLM_F_DUMP. */
static request make_request(uint16_t type, uint16_t flags)
{
    return (request){
        .header = {.nlmsg_len = NLMSG_LENGTH(sizeof(struct ifinfomsg)),
                   .nlmsg_type = type,
                   .nlmsg_flags = (uint16_t)(NLM_F_REQUEST | flags)},
        .info = {.ifi_family = AF_UNSPEC},
    };
}

/* Adds bytes to the end of a request. */
static void *extend(request *r, size_t size)
{
    size_t end = NLMSG_ALIGN(r->header.nlmsg_len);
    if (end + size > sizeof *r)
        abort(); /* names and aliases have a maximum */
    r->header.nlmsg_len = (uint32_t)(end + size);
    return (char *)r + end;
}

/* Copies a header by bytes: the compiler treats the request as an array of characters and may
 * discard writes of other types. */
static char *put_head(char *to, size_t size, unsigned short type)
{
    const struct rtattr head = {.rta_len = (unsigned short)RTA_LENGTH(size), .rta_type = type};
    memcpy(to, &head, sizeof head);
    return to + RTA_LENGTH(0);
}

static void links_put(request *r, unsigned short type, const void *data, size_t size)
{
    char *to = put_head(extend(r, RTA_LENGTH(size)), size, type);
    if (size > 0)
        memcpy(to, data, size);
}

static void put_text(request *r, unsigned short type, const char *text)
{
    links_put(r, type, text, strlen(text) + 1);
}

/* The beginning of an attribute that contains others. */
typedef struct nesting {
    char *at;
    unsigned short type;
} nesting;

static nesting links_begin(request *r, unsigned short type)
{
    return (nesting){.at = extend(r, RTA_LENGTH(0)), .type = type};
}

static void links_end(request *r, nesting n)
{
    size_t whole = (size_t)((char *)r + r->header.nlmsg_len - n.at);
    (void)put_head(n.at, whole - RTA_LENGTH(0), n.type);
}

/* ---- Replies --------------------------------------------------------------------------------- */

static void copy_text(char *out, size_t size, const struct rtattr *attribute)
{
    (void)snprintf(out, size, "%.*s", (int)RTA_PAYLOAD(attribute),
                   (const char *)RTA_DATA(attribute));
}

/* Attributes in a piece of memory. */
typedef struct attributes {
    char *first;
    size_t size;
} attributes;

/* Takes the first attribute; returns NULL at the end. */
static struct rtattr *take_attribute(attributes *in)
{
    struct rtattr *a = (struct rtattr *)in->first;
    if (in->size < sizeof *a || a->rta_len < sizeof *a || a->rta_len > in->size)
        return NULL;
    size_t length = RTA_ALIGN(a->rta_len);
    length = length < in->size ? length : in->size;
    in->first += length;
    in->size -= length;
    return a;
}

/* Takes the kind of an interface ("vcan", "vxcan") out of its nested attributes. */
static void read_kind(link_info *out, struct rtattr *nest)
{
    attributes in = {.first = RTA_DATA(nest), .size = RTA_PAYLOAD(nest)};
    for (struct rtattr *a; (a = take_attribute(&in));)
        if (a->rta_type == IFLA_INFO_KIND)
            copy_text(out->kind, sizeof out->kind, a);
}

/* Reads a message about an interface. Attributes that are missing leave their fields empty. */
static void read_link(link_info *out, struct nlmsghdr *message)
{
    struct ifinfomsg *info = NLMSG_DATA(message);
    attributes in = {.first = (char *)IFLA_RTA(info), .size = IFLA_PAYLOAD(message)};
    *out = (link_info){.index = (unsigned)info->ifi_index, .up = info->ifi_flags & IFF_UP};
    for (struct rtattr *a; (a = take_attribute(&in));) {
        if (a->rta_type == IFLA_IFNAME)
            copy_text(out->name, sizeof out->name, a);
        else if (a->rta_type == IFLA_IFALIAS)
            copy_text(out->alias, sizeof out->alias, a);
        else if (a->rta_type == IFLA_LINKINFO)
            read_kind(out, a);
        else if (a->rta_type == IFLA_MTU && RTA_PAYLOAD(a) == sizeof out->mtu)
            memcpy(&out->mtu, RTA_DATA(a), sizeof out->mtu);
    }
}

/* Reads an error, and the kernel's text behind it, if there is one. */
static int read_error(links *l, struct nlmsghdr *message)
{
    const struct nlmsgerr *reply = NLMSG_DATA(message);
    int number = -reply->error;
    (void)snprintf(l->error, sizeof l->error, "%s", strerror(number));
    if (number == 0 || !(message->nlmsg_flags & NLM_F_ACK_TLVS))
        return number;
    size_t skip = sizeof *reply;
    if (!(message->nlmsg_flags & NLM_F_CAPPED))
        skip += reply->msg.nlmsg_len - sizeof reply->msg;
    skip = NLMSG_LENGTH(NLMSG_ALIGN(skip));
    if (skip > message->nlmsg_len)
        return number;
    attributes in = {.first = (char *)message + skip, .size = message->nlmsg_len - skip};
    for (struct rtattr *a; (a = take_attribute(&in));)
        if ((a->rta_type & NLA_TYPE_MASK) == NLMSGERR_ATTR_MSG)
            copy_text(l->error, sizeof l->error, a);
    return number;
}

static int links_fail(links *l, int number)
{
    (void)snprintf(l->error, sizeof l->error, "%s", strerror(number));
    return number;
}

/* Takes one message. Returns -1 before the end, otherwise the result of the request. */
static int links_take(links *l, listener *to, struct nlmsghdr *message)
{
    link_info info;
    if (message->nlmsg_seq != l->sequence)
        return -1;
    if (message->nlmsg_type == NLMSG_DONE)
        return 0;
    if (message->nlmsg_type == NLMSG_ERROR)
        return read_error(l, message);
    if (message->nlmsg_type != RTM_NEWLINK)
        return -1;
    read_link(&info, message);
    if (to->visit && !to->done)
        to->done = !to->visit(to->user, &info);
    return -1;
}

/* Takes messages until the kernel has answered the request. Returns 0 or an errno. A connection
 * whose answer is lost keeps that in mind: later messages could belong to the old request. */
static int links_receive(links *l, listener *to)
{
    for (;;) {
        ssize_t size = recv(l->fd, l->reply.bytes, sizeof l->reply.bytes, MSG_TRUNC);
        if (size < 0 && errno == EINTR)
            continue;
        l->unanswered = size < 0 || (size_t)size > sizeof l->reply.bytes;
        if (l->unanswered)
            return links_fail(l, size < 0 ? errno : EMSGSIZE);
        unsigned rest = (unsigned)size;
        for (struct nlmsghdr *m = &l->reply.header; NLMSG_OK(m, rest); m = NLMSG_NEXT(m, rest)) {
            int result = links_take(l, to, m);
            if (result >= 0)
                return result;
        }
    }
}

/* Sends a request and reads its whole answer. */
static int ask(links *l, request *r, links_visitor *visit, void *user)
{
    listener to = {.visit = visit, .user = user};
    r->header.nlmsg_seq = ++l->sequence;
    l->unanswered = false;
    if (send(l->fd, r, r->header.nlmsg_len, 0) < 0)
        return links_fail(l, errno);
    return links_receive(l, &to);
}

/* ---- Public functions ------------------------------------------------------------------------ */

links *links_open(void)
{
    static const int on = 1;
    links *l = calloc(1, sizeof *l);
    if (!l)
        return NULL;
    l->fd = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
    if (l->fd < 0) {
        free(l);
        return NULL;
    }
    (void)setsockopt(l->fd, SOL_NETLINK, NETLINK_EXT_ACK, &on, sizeof on); /* for its error texts */
    return l;
}

void links_close(links *l)
{
    if (!l)
        return;
    (void)close(l->fd);
    free(l);
}

static bool links_keep(void *user, const link_info *info)
{
    link_info *out = user;
    *out = *info;
    return false;
}

int links_find(links *l, link_info *info, const char *name)
{
    request r = make_request(RTM_GETLINK, NLM_F_ACK);
    put_text(&r, IFLA_IFNAME, name);
    return ask(l, &r, links_keep, info);
}

int links_each(links *l, links_visitor *visit, void *user)
{
    request r = make_request(RTM_GETLINK, NLM_F_DUMP);
    return ask(l, &r, visit, user);
}

static void put_mtu(request *r, uint32_t mtu)
{
    links_put(r, IFLA_MTU, &mtu, sizeof mtu);
}

/* Makes a request for a new interface that is up. */
static request make_new(const char *name, unsigned mtu)
{
    request r = make_request(RTM_NEWLINK, NLM_F_ACK | NLM_F_CREATE | NLM_F_EXCL);
    r.info.ifi_flags = IFF_UP;
    r.info.ifi_change = IFF_UP;
    put_text(&r, IFLA_IFNAME, name);
    put_mtu(&r, mtu);
    return r;
}

int links_make_vcan(links *l, const char *name, unsigned mtu)
{
    request r = make_new(name, mtu);
    nesting info = links_begin(&r, IFLA_LINKINFO);
    put_text(&r, IFLA_INFO_KIND, "vcan");
    links_end(&r, info);
    return ask(l, &r, NULL, NULL);
}

static int find_index(links *l, int index)
{
    request r = make_request(RTM_GETLINK, NLM_F_ACK);
    r.info.ifi_index = index;
    return ask(l, &r, NULL, NULL);
}

/* Makes a pair. The kernel sets only the first one up, since the second does not exist then. So the
 * peer is the first. The second is in this namespace, where it can be set up later. index: of the
 * peer, 0: the kernel chooses. */
static int make_pair(links *l, const char *name, const char *peer, int netns_fd, int index,
                     unsigned mtu)
{
    request r = make_new(peer, mtu);
    r.info.ifi_index = index;
    if (netns_fd >= 0)
        links_put(&r, IFLA_NET_NS_FD, &netns_fd, sizeof netns_fd);
    nesting info = links_begin(&r, IFLA_LINKINFO);
    put_text(&r, IFLA_INFO_KIND, "vxcan");
    nesting data = links_begin(&r, IFLA_INFO_DATA);
    nesting other = links_begin(&r, VXCAN_INFO_PEER);
    const struct ifinfomsg header = {.ifi_family = AF_UNSPEC};
    memcpy(extend(&r, sizeof header), &header, sizeof header);
    put_text(&r, IFLA_IFNAME, name);
    put_mtu(&r, mtu);
    links_end(&r, other);
    links_end(&r, data);
    links_end(&r, info);
    return ask(l, &r, NULL, NULL);
}

/* For another namespace the request has an index. Without one the kernel takes an interface of the
 * peer's name in this namespace for the new one. The index has to be free here and there. */
int links_make_vxcan(links *l, const char *name, const char *peer, int netns_fd, unsigned mtu)
{
    if (netns_fd < 0)
        return make_pair(l, name, peer, netns_fd, 0, mtu);
    int number = EBUSY;
    for (int i = 0; number == EBUSY && i < INDEX_TRIES; i++) {
        const int here = find_index(l, INDEX_FIRST + i);
        if (here == ENODEV)
            number = make_pair(l, name, peer, netns_fd, INDEX_FIRST + i, mtu);
        else if (here != 0)
            return here;
    }
    return number == EBUSY ? links_fail(l, EBUSY) : number;
}

/* Returns a request that sets an existing interface up or down. */
static request make_change(const char *name, unsigned flags)
{
    request r = make_request(RTM_SETLINK, NLM_F_ACK);
    r.info.ifi_flags = flags;
    r.info.ifi_change = IFF_UP;
    put_text(&r, IFLA_IFNAME, name);
    return r;
}

/* Sets a link up that was up before. The error is that of what has failed meanwhile. */
static void set_up_again(links *l, const char *name)
{
    char error[ERROR_BYTES];
    const bool unanswered = l->unanswered;
    request up = make_change(name, IFF_UP);
    memcpy(error, l->error, sizeof error);
    (void)ask(l, &up, NULL, NULL);
    memcpy(l->error, error, sizeof error);
    l->unanswered = unanswered;
}

int links_set_mtu(links *l, const char *name, unsigned mtu)
{
    link_info before;
    int number = links_find(l, &before, name);
    if (number != 0)
        return number;
    request down = make_change(name, 0);
    number = ask(l, &down, NULL, NULL);
    request up = make_change(name, IFF_UP); /* the kernel changes the MTU first */
    put_mtu(&up, mtu);
    if (number == 0)
        number = ask(l, &up, NULL, NULL);
    if (number != 0 && before.up)
        set_up_again(l, name);
    return number;
}

int links_set(links *l, const char *name, const char *alias)
{
    request r = make_change(name, IFF_UP);
    if (alias)
        links_put(&r, IFLA_IFALIAS, alias, strlen(alias));
    return ask(l, &r, NULL, NULL);
}

int links_move(links *l, unsigned index, const char *name, int netns_fd)
{
    request r = make_request(RTM_NEWLINK, NLM_F_ACK);
    r.info.ifi_index = (int)index;
    put_text(&r, IFLA_IFNAME, name);
    if (netns_fd >= 0)
        links_put(&r, IFLA_NET_NS_FD, &netns_fd, sizeof netns_fd);
    return ask(l, &r, NULL, NULL);
}

int links_remove(links *l, const char *name)
{
    request r = make_request(RTM_DELLINK, NLM_F_ACK);
    put_text(&r, IFLA_IFNAME, name);
    return ask(l, &r, NULL, NULL);
}

const char *links_error(const links *l)
{
    return l->error;
}

bool links_unanswered(const links *l)
{
    return l->unanswered;
}
