/* SPDX-License-Identifier: MIT
 *
 * address.c - the address of a port in a network.
 */
#include "config/node/address.h"

#include "base/text/number.h"

#include <arpa/inet.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define LOOPBACK_BROADCAST 0x7FFFFFFFu /* 127.255.255.255 */

/* Copies an address in numbers, in the one way in which it is printed. */
static bool take_host(char out[ADDRESS_HOST_BYTES], const char *text, size_t length)
{
    char host[ADDRESS_HOST_BYTES];
    unsigned char address[sizeof(struct in6_addr)];
    const bool six = length > 2 && text[0] == '[' && text[length - 1] == ']';
    const int family = six ? AF_INET6 : AF_INET;
    if (length + 1 > sizeof host)
        return false;
    (void)snprintf(host, sizeof host, "%.*s", (int)(length - (six ? 2 : 0)), text + six);
    if (strcmp(host, "localhost") == 0)
        strcpy(host, "127.0.0.1");
    return inet_pton(family, host, address) == 1 &&
           inet_ntop(family, address, out, ADDRESS_HOST_BYTES);
}

/* Takes the number of a TCP or UDP port, which is all of the text. 0 would be any. */
static bool take_number(unsigned *out, const char *text, size_t length)
{
    const char *end = text;
    uint64_t number = 0;
    if (!text_take_uint(&number, &end, UINT16_MAX) || end != text + length || number == 0)
        return false;
    *out = (unsigned)number;
    return true;
}

/* Returns the bytes before the colon of a port; all of them without one. */
static size_t host_length(const char *text, size_t length)
{
    size_t host = length;
    while (host > 0 && text[host - 1] != ':' && text[host - 1] != ']')
        host--;
    return host == 0 || text[host - 1] == ']' ? length : host - 1;
}

bool address_parse(net_address *out, const char *text, size_t length, unsigned number)
{
    const size_t host = host_length(text, length);
    strcpy(out->host, "127.0.0.1");
    out->number = number;
    if (length == 0 || take_number(&out->number, text, length))
        return true;
    return take_host(out->host, text, host) &&
           (host == length || take_number(&out->number, text + host + 1, length - host - 1));
}

const char *address_expected(const char *text, size_t length)
{
    char host[ADDRESS_HOST_BYTES];
    const size_t bytes = host_length(text, length);
    const bool is_number = length > 0 && strspn(text, "0123456789") >= length;
    if (is_number || (bytes < length && take_host(host, text, bytes)))
        return "a port number 1..65535 without leading zeros";
    return "an IPv4 address, an IPv6 address in brackets, or localhost, maybe with :PORT";
}

const char *address_of_many(const net_address *address)
{
    struct sockaddr_storage any;
    const struct sockaddr_in *four = (const struct sockaddr_in *)&any;
    const struct sockaddr_in6 *six = (const struct sockaddr_in6 *)&any;
    (void)address_for_socket(&any, address);
    if (any.ss_family == AF_INET6)
        return IN6_IS_ADDR_MULTICAST(&six->sin6_addr) ? "multicast" : NULL;
    const in_addr_t host = ntohl(four->sin_addr.s_addr);
    if (host == INADDR_BROADCAST || host == LOOPBACK_BROADCAST)
        return "broadcast";
    return IN_MULTICAST(host) ? "multicast" : NULL;
}

bool address_of_all(const net_address *address)
{
    return strcmp(address->host, "0.0.0.0") == 0 || strcmp(address->host, "::") == 0;
}

void address_print(char out[ADDRESS_BYTES], const net_address *address)
{
    const bool six = strchr(address->host, ':');
    (void)snprintf(out, ADDRESS_BYTES, "%s%s%s:%u", six ? "[" : "", address->host, six ? "]" : "",
                   address->number);
}

socklen_t address_for_socket(struct sockaddr_storage *out, const net_address *address)
{
    const in_port_t port = htons((uint16_t)address->number);
    struct sockaddr_in four = {.sin_family = AF_INET, .sin_port = port};
    struct sockaddr_in6 six = {.sin6_family = AF_INET6, .sin6_port = port};
    if (inet_pton(AF_INET, address->host, &four.sin_addr) == 1) {
        memcpy(out, &four, sizeof four);
        return sizeof four;
    }
    (void)inet_pton(AF_INET6, address->host, &six.sin6_addr);
    memcpy(out, &six, sizeof six);
    return sizeof six;
}
