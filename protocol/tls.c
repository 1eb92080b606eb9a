#include "protocol/tls.h"

#include <limits.h>
#include <openssl/bio.h>
#include <openssl/crypto.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "common/base/memory.h"

#define CIPHER_SUITE "TLS_AES_128_GCM_SHA256"

/* The suite's code point. A PSK belongs to one hash; both ends name this one, SHA-256. */
static const unsigned char cipher_id[2] = {0x13, 0x01};

struct tls {
    SSL *ssl;
    BIO *in, *out; /* owned by ssl */
    struct farm_key key;
    struct key_identity id;
    enum tls_state state;
    int is_server;
    int key_unknown;                  /* server: the client gave no name, or one whose key ours cannot check */
    char identity[KEY_IDENTITY_SIZE]; /* client: the text of `id` */
};

/* ---- the pre-shared key ---------------------------------------------------------------- */

static SSL_SESSION *session_new(SSL *ssl, const uint8_t secret[FARM_KEY_BYTES])
{
    const SSL_CIPHER *cipher = SSL_CIPHER_find(ssl, cipher_id);
    SSL_SESSION *session = SSL_SESSION_new();

    if (!session || !cipher || !SSL_SESSION_set1_master_key(session, secret, FARM_KEY_BYTES) ||
        !SSL_SESSION_set_cipher(session, cipher) || !SSL_SESSION_set_protocol_version(session, TLS1_3_VERSION)) {
        SSL_SESSION_free(session);
        return NULL;
    }
    return session;
}

static int client_psk(SSL *ssl, const EVP_MD *md, const unsigned char **id, size_t *id_size, SSL_SESSION **session)
{
    struct tls *t = SSL_get_app_data(ssl);
    uint8_t secret[FARM_KEY_BYTES];

    *session = NULL;
    *id = NULL;
    *id_size = 0;
    if (md && EVP_MD_get_type(md) != NID_sha256)
        return 1; /* a server that chose another hash cannot use our key */
    if (farm_key_secret(&t->key, &t->id, secret, NULL) != STATUS_OK)
        return 0;
    *session = session_new(ssl, secret);
    OPENSSL_cleanse(secret, sizeof secret);
    if (!*session)
        return 0;
    *id = (const unsigned char *)t->identity;
    *id_size = strlen(t->identity);
    return 1;
}

static int server_psk(SSL *ssl, const unsigned char *id, size_t id_size, SSL_SESSION **session)
{
    struct tls *t = SSL_get_app_data(ssl);
    uint8_t secret[FARM_KEY_BYTES];

    *session = NULL;
    if (!key_identity_parse(&t->id, id, id_size) || farm_key_secret(&t->key, &t->id, secret, NULL) != STATUS_OK) {
        memset(&t->id, 0, sizeof t->id);
        t->key_unknown = 1;
        return 1; /* no session: the handshake then fails for lack of a certificate */
    }
    *session = session_new(ssl, secret);
    OPENSSL_cleanse(secret, sizeof secret);
    return *session != NULL;
}

/* ---- life ------------------------------------------------------------------------------ */

static SSL_CTX *context_new(int is_server)
{
    SSL_CTX *ctx = SSL_CTX_new(is_server ? TLS_server_method() : TLS_client_method());

    if (!ctx || !SSL_CTX_set_min_proto_version(ctx, TLS1_3_VERSION) ||
        !SSL_CTX_set_max_proto_version(ctx, TLS1_3_VERSION) || !SSL_CTX_set_ciphersuites(ctx, CIPHER_SUITE) ||
        (is_server && !SSL_CTX_set_num_tickets(ctx, 0))) {
        SSL_CTX_free(ctx);
        return NULL;
    }
    SSL_CTX_set_session_cache_mode(ctx, SSL_SESS_CACHE_OFF);
    SSL_CTX_set_options(ctx, SSL_OP_NO_TICKET | SSL_OP_NO_COMPRESSION | SSL_OP_NO_RENEGOTIATION);
    SSL_CTX_set_mode(ctx, SSL_MODE_RELEASE_BUFFERS);
    if (is_server) {
        SSL_CTX_set_psk_find_session_callback(ctx, server_psk);
    } else {
        /* No certificate is trusted, so a server that presents one instead of proving the key is refused. */
        SSL_CTX_set_verify(ctx, SSL_VERIFY_PEER, NULL);
        SSL_CTX_set_psk_use_session_callback(ctx, client_psk);
    }
    return ctx;
}

/* Shared by all connections of a process; it holds no key. A context takes 100 KB and a
 * millisecond, so each side makes one when its first connection needs it, and keeps it. NULL if
 * OpenSSL cannot make one; the next connection tries again. */
static SSL_CTX *context_of(int is_server)
{
    static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    static SSL_CTX *contexts[2];
    SSL_CTX *ctx;

    pthread_mutex_lock(&lock);
    if (!contexts[is_server])
        contexts[is_server] = context_new(is_server);
    ctx = contexts[is_server];
    pthread_mutex_unlock(&lock);
    return ctx;
}

static status tls_new(struct tls **out, const struct farm_key *key, int is_server, const struct key_identity *id,
                      struct error *err)
{
    struct tls *t = mem_calloc(1, sizeof *t);
    SSL_CTX *ctx;

    *out = NULL;
    NEED(t, err, "a TLS connection");
    t->key = *key;
    t->id = *id;
    t->is_server = is_server;
    (void)key_identity_print(id, t->identity);
    ERR_clear_error();
    ctx = context_of(is_server);
    t->ssl = ctx ? SSL_new(ctx) : NULL;
    t->in = BIO_new(BIO_s_mem());
    t->out = BIO_new(BIO_s_mem());
    if (!t->ssl || !t->in || !t->out || !SSL_set_app_data(t->ssl, t)) {
        BIO_free(t->in);
        BIO_free(t->out);
        tls_free(t);
        ERR_clear_error();
        return error_set(err, STATUS_ERR_INTERNAL,
                         "OpenSSL gives no TLS 1.3 with " CIPHER_SUITE " (out of memory, or a "
                         "system-wide policy forbids it)");
    }
    BIO_set_mem_eof_return(t->in, -1);
    BIO_set_mem_eof_return(t->out, -1);
    SSL_set_bio(t->ssl, t->in, t->out);
    if (is_server)
        SSL_set_accept_state(t->ssl);
    else
        SSL_set_connect_state(t->ssl);
    *out = t;
    return STATUS_OK;
}

status tls_new_client(struct tls **out, const struct farm_key *key, enum farm_role role, struct error *err)
{
    struct key_identity id;
    status s = farm_key_identity(key, role, &id, err);

    *out = NULL;
    return s == STATUS_OK ? tls_new(out, key, 0, &id, err) : s;
}

status tls_new_server(struct tls **out, const struct farm_key *key, struct error *err)
{
    const struct key_identity none = {0};

    return tls_new(out, key, 1, &none, err);
}

void tls_free(struct tls *t)
{
    if (!t)
        return;
    SSL_free(t->ssl);
    OPENSSL_cleanse(&t->key, sizeof t->key);
    mem_free(t);
}

/* ---- the conversation ------------------------------------------------------------------ */

/* The meaning of a failed handshake, from OpenSSL's error queue: a wrong key shows as a binder that
 * does not verify (server) or as the alert about it (client). */
static status handshake_failed(struct tls *t, struct error *err)
{
    unsigned long code = ERR_peek_error();
    int reason = ERR_GET_REASON(code);
    char words[160], key[KEY_WORDS_SIZE];

    t->state = TLS_FAILED;
    (void)key_identity_words(&t->id, key);
    ERR_error_string_n(code, words, sizeof words);
    ERR_clear_error();
    if (t->is_server) {
        if (reason == SSL_R_BINDER_DOES_NOT_VERIFY || reason == SSL_R_BAD_PSK || reason == SSL_R_DIGEST_CHECK_FAILED)
            return error_set(err, STATUS_ERR_REFUSED, "its %s is not of this farm (the key files differ)", key);
        if (t->key_unknown)
            return error_set(err, STATUS_ERR_REFUSED, "it named no role, or a name whose key this end does not hold");
        if (reason == SSL_R_NO_SHARED_CIPHER || reason == SSL_R_NO_SUITABLE_SIGNATURE_ALGORITHM ||
            reason == SSL_R_MISSING_SIGALGS_EXTENSION || reason == SSL_R_NO_SUITABLE_KEY_SHARE)
            return error_set(err, STATUS_ERR_REFUSED, "it offered no farm key");
    } else {
        switch (reason) {
        case SSL_R_SSLV3_ALERT_ILLEGAL_PARAMETER:
        case SSL_R_SSLV3_ALERT_HANDSHAKE_FAILURE:
        case SSL_R_TLSV1_ALERT_DECRYPT_ERROR:
        case SSL_R_TLSV1_ALERT_ACCESS_DENIED:
        case SSL_AD_REASON_OFFSET + SSL_AD_UNKNOWN_PSK_IDENTITY: /* the name is not in OpenSSL 3.0.13 */
        case SSL_R_TLSV13_ALERT_CERTIFICATE_REQUIRED:
            return error_set(err, STATUS_ERR_REFUSED,
                             "the %s was not taken: it belongs to another farm (use a copy of "
                             "the coordinator's key file, or a key derived from it)",
                             key);
        case SSL_R_CERTIFICATE_VERIFY_FAILED:
        case SSL_R_DIGEST_CHECK_FAILED:
        case SSL_R_BAD_DIGEST_LENGTH:
            return error_set(err, STATUS_ERR_REFUSED, "the other end could not prove that it holds the farm key");
        default: break;
        }
    }
    return error_set(err, STATUS_ERR_PROTOCOL, "it does not speak Azulejo's TLS 1.3 (%s)", words);
}

status tls_feed(struct tls *t, const void *data, size_t size_bytes, struct error *err)
{
    const uint8_t *at = data;

    while (size_bytes > 0) {
        int piece = size_bytes > INT_MAX ? INT_MAX : (int)size_bytes;
        int put = BIO_write(t->in, at, piece);
        if (put <= 0) {
            ERR_clear_error();
            return error_no_memory(err, "bytes being received");
        }
        at += put;
        size_bytes -= (size_t)put;
    }
    return STATUS_OK;
}

status tls_step(struct tls *t, struct error *err)
{
    int result, kind;

    if (t->state != TLS_HANDSHAKE)
        return STATUS_OK;
    ERR_clear_error();
    result = SSL_do_handshake(t->ssl);
    if (result == 1) {
        /* As a second safeguard, only a handshake that used the pre-shared key counts. */
        if (!SSL_session_reused(t->ssl) || t->id.role == FARM_ROLE_NONE) {
            t->state = TLS_FAILED;
            return error_set(err, STATUS_ERR_REFUSED, "it did not prove a farm key");
        }
        t->state = TLS_OPEN;
        return STATUS_OK;
    }
    kind = SSL_get_error(t->ssl, result);
    if (kind == SSL_ERROR_WANT_READ || kind == SSL_ERROR_WANT_WRITE)
        return STATUS_OK;
    return handshake_failed(t, err);
}

status tls_read(struct tls *t, void *out, size_t capacity, size_t *got, struct error *err)
{
    int kind;
    char words[160];

    *got = 0;
    if (t->state == TLS_ENDED)
        return STATUS_OK;
    if (t->state != TLS_OPEN)
        return error_set(err, STATUS_ERR_INTERNAL, "reading from a TLS connection that is not open");
    ERR_clear_error();
    if (SSL_read_ex(t->ssl, out, capacity, got) == 1)
        return STATUS_OK;
    *got = 0;
    kind = SSL_get_error(t->ssl, 0);
    if (kind == SSL_ERROR_WANT_READ || kind == SSL_ERROR_WANT_WRITE)
        return STATUS_OK;
    if (kind == SSL_ERROR_ZERO_RETURN) {
        t->state = TLS_ENDED;
        return STATUS_OK;
    }
    t->state = TLS_FAILED;
    ERR_error_string_n(ERR_peek_error(), words, sizeof words);
    ERR_clear_error();
    return error_set(err, STATUS_ERR_PROTOCOL, "damaged TLS records (%s)", words);
}

status tls_write(struct tls *t, const void *data, size_t size_bytes, struct error *err)
{
    size_t put;

    if (t->state != TLS_OPEN)
        return error_set(err, STATUS_ERR_INTERNAL, "writing to a TLS connection that is not open");
    ERR_clear_error();
    if (SSL_write_ex(t->ssl, data, size_bytes, &put) == 1 && put == size_bytes)
        return STATUS_OK;
    ERR_clear_error();
    t->state = TLS_FAILED;
    return error_no_memory(err, "a message being sent");
}

void tls_end(struct tls *t)
{
    if (t->state != TLS_OPEN && t->state != TLS_ENDED)
        return;
    ERR_clear_error();
    if (SSL_shutdown(t->ssl) < 0)
        ERR_clear_error(); /* the peer then sees the stream end without a close_notify */
}

size_t tls_output_bytes(const struct tls *t) { return BIO_ctrl_pending(t->out); }

size_t tls_output_take(struct tls *t, void *out, size_t capacity)
{
    int got = BIO_read(t->out, out, capacity > INT_MAX ? INT_MAX : (int)capacity);

    return got > 0 ? (size_t)got : 0;
}

enum tls_state tls_state_of(const struct tls *t) { return t->state; }

struct key_identity tls_identity(const struct tls *t)
{
    const struct key_identity none = {0};

    return t->state == TLS_OPEN || t->state == TLS_ENDED ? t->id : none;
}

enum farm_role tls_role(const struct tls *t) { return tls_identity(t).role; }
