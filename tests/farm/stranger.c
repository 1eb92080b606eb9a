/* stranger: a TLS 1.3 server that knows no farm key and shows a certificate of its own making.
 *
 *   stranger        listens on a free port of 127.0.0.1, prints "listening on PORT", and serves
 *                   one connection after the other until its standard input ends
 *
 * It prints "met" when a handshake has ended, one way or the other.
 */
#include <arpa/inet.h>
#include <openssl/err.h>
#include <openssl/evp.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>
#include <unistd.h>

static _Noreturn void die(const char *why)
{
    fprintf(stderr, "stranger: %s\n", why);
    exit(1);
}

/* A self-signed certificate for a new key, good for an hour. */
static SSL_CTX *make_context(void)
{
    SSL_CTX *ctx = SSL_CTX_new(TLS_server_method());
    EVP_PKEY *key = EVP_EC_gen("P-256");
    X509 *certificate = X509_new();
    X509_NAME *name = certificate ? X509_get_subject_name(certificate) : NULL;

    if (!ctx || !key || !name ||
        !X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, (const unsigned char *)"stranger", -1, -1, 0) ||
        !X509_set_issuer_name(certificate, name) || !X509_gmtime_adj(X509_getm_notBefore(certificate), 0) ||
        !X509_gmtime_adj(X509_getm_notAfter(certificate), 3600) || !X509_set_pubkey(certificate, key) ||
        !X509_sign(certificate, key, EVP_sha256()) || SSL_CTX_use_certificate(ctx, certificate) != 1 ||
        SSL_CTX_use_PrivateKey(ctx, key) != 1)
        die("no certificate can be made");
    X509_free(certificate);
    EVP_PKEY_free(key);
    return ctx;
}

static int listen_on_loopback(void)
{
    struct sockaddr_in address = {.sin_family = AF_INET};
    socklen_t size = sizeof address;
    int fd = socket(AF_INET, SOCK_STREAM, 0);

    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (fd < 0 || bind(fd, (struct sockaddr *)&address, size) != 0 || listen(fd, 16) != 0 ||
        getsockname(fd, (struct sockaddr *)&address, &size) != 0)
        die("cannot listen");
    printf("listening on %u\n", ntohs(address.sin_port));
    return fd;
}

static void serve(SSL_CTX *ctx, int listener)
{
    int fd = accept(listener, NULL, NULL);
    SSL *ssl = SSL_new(ctx);

    if (fd < 0 || !ssl || !SSL_set_fd(ssl, fd))
        die("cannot accept");
    (void)!SSL_accept(ssl); /* fails: the worker wants no certificate */
    ERR_clear_error();
    printf("met\n");
    SSL_free(ssl);
    close(fd);
}

int main(void)
{
    struct pollfd sources[2] = {{.fd = STDIN_FILENO, .events = POLLIN}, {.events = POLLIN}};
    SSL_CTX *ctx = make_context();

    setvbuf(stdout, NULL, _IOLBF, 0);
    signal(SIGPIPE, SIG_IGN);
    sources[1].fd = listen_on_loopback();
    while (poll(sources, 2, -1) > 0 && !sources[0].revents)
        if (sources[1].revents)
            serve(ctx, sources[1].fd);
    SSL_CTX_free(ctx);
    close(sources[1].fd);
    return 0;
}
