#include "web/base/certificate.h"

#include <stdio.h>
#include <time.h>

#include <openssl/bio.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/rand.h>
#include <openssl/x509v3.h>

#include "common/base/buffer.h"
#include "common/system/file.h"
#include "protocol/address.h"

enum { FILE_MAX = 1 << 20, DAY_S = 86400 };

static status load(const char *path, X509 **out, struct error *err)
{
    struct buffer text = BUFFER_INIT;
    status s = file_read(path, FILE_MAX, &text, err);
    BIO *source = s == STATUS_OK ? BIO_new_mem_buf(buffer_text(&text), (int)text.size) : NULL;

    *out = source ? PEM_read_bio_X509(source, NULL, NULL, NULL) : NULL;
    BIO_free(source);
    buffer_release(&text);
    if (s == STATUS_OK && !*out)
        s = error_set(err, STATUS_ERR_INPUT, "%s: holds no certificate in PEM", path);
    return s;
}

/* After a crash between the two files they do not belong together. */
static int is_key_of(X509 *certificate, const char *key_path)
{
    struct buffer text = BUFFER_INIT;
    BIO *source = file_read(key_path, FILE_MAX, &text, NULL) == STATUS_OK
                      ? BIO_new_mem_buf(buffer_text(&text), (int)text.size)
                      : NULL;
    EVP_PKEY *key = source ? PEM_read_bio_PrivateKey(source, NULL, NULL, NULL) : NULL;
    const int is = key && X509_check_private_key(certificate, key) == 1;

    EVP_PKEY_free(key);
    BIO_free(source);
    if (text.data)
        OPENSSL_cleanse(text.data, text.size);
    buffer_release(&text);
    return is;
}

static int is_good_for(X509 *certificate, const char *name)
{
    time_t soon = time(NULL) + (time_t)CERTIFICATE_SPARE_DAYS * DAY_S;

    if (X509_cmp_time(X509_get0_notAfter(certificate), &soon) <= 0)
        return 0;
    return address_is_number(name) ? X509_check_ip_asc(certificate, name, 0) == 1
                                   : X509_check_host(certificate, name, 0, 0, NULL) == 1;
}

static int add_extension(X509 *certificate, int kind, const char *value)
{
    X509V3_CTX context;
    X509_EXTENSION *extension;
    int ok;

    X509V3_set_ctx_nodb(&context);
    X509V3_set_ctx(&context, certificate, certificate, NULL, NULL, 0);
    extension = X509V3_EXT_conf_nid(NULL, &context, kind, value);
    ok = extension && X509_add_ext(certificate, extension, -1) == 1;
    X509_EXTENSION_free(extension);
    return ok;
}

/* Its subject is only for people; the alternative names are what clients check. */
static int fill(X509 *certificate, EVP_PKEY *key, const char *name)
{
    unsigned char serial[16];
    char names[400];
    X509_NAME *subject = X509_get_subject_name(certificate);
    BIGNUM *number;
    int ok;

    snprintf(names, sizeof names, "%s:%.255s,DNS:localhost,IP:127.0.0.1,IP:::1", address_is_number(name) ? "IP" : "DNS", name);
    if (RAND_bytes(serial, sizeof serial) != 1)
        return 0;
    serial[0] &= 0x7f;
    number = BN_bin2bn(serial, sizeof serial, NULL);
    ok = number && BN_to_ASN1_INTEGER(number, X509_get_serialNumber(certificate));
    BN_free(number);
    return ok && X509_set_version(certificate, X509_VERSION_3) == 1 &&
           X509_gmtime_adj(X509_getm_notBefore(certificate), -DAY_S) &&
           X509_gmtime_adj(X509_getm_notAfter(certificate), (long)(CERTIFICATE_DAYS - 1) * DAY_S) &&
           X509_NAME_add_entry_by_txt(subject, "CN", MBSTRING_ASC, (const unsigned char *)"Azulejo page", -1, -1, 0) &&
           X509_set_issuer_name(certificate, subject) == 1 && X509_set_pubkey(certificate, key) == 1 &&
           add_extension(certificate, NID_subject_alt_name, names) &&
           add_extension(certificate, NID_basic_constraints, "critical,CA:FALSE") &&
           add_extension(certificate, NID_key_usage, "critical,digitalSignature") &&
           add_extension(certificate, NID_ext_key_usage, "serverAuth") && X509_sign(certificate, key, EVP_sha256()) > 0;
}

static status save(const char *path, BIO *text, struct error *err)
{
    char *data;
    const long size = BIO_get_mem_data(text, &data);

    return file_write_private(path, data, (size_t)size, err);
}

static status make(const char *cert_path, const char *key_path, const char *name, struct error *err)
{
    EVP_PKEY *key = EVP_EC_gen("P-256");
    X509 *certificate = X509_new();
    BIO *cert_text = BIO_new(BIO_s_mem()), *key_text = BIO_new(BIO_s_secmem());
    status s;

    if (!key || !certificate || !cert_text || !key_text || !fill(certificate, key, name) ||
        PEM_write_bio_X509(cert_text, certificate) != 1 ||
        PEM_write_bio_PrivateKey(key_text, key, NULL, NULL, 0, NULL, NULL) != 1)
        s = error_set(err, STATUS_ERR_INTERNAL, "OpenSSL made no certificate for the page, named '%s'", name);
    else
        s = save(key_path, key_text, err);
    THEN(s, save(cert_path, cert_text, err));
    BIO_free(cert_text);
    BIO_free(key_text);
    X509_free(certificate);
    EVP_PKEY_free(key);
    return s;
}

status certificate_ensure(const char *cert_path, const char *key_path, const char *name, int *made, struct error *err)
{
    X509 *there = NULL;
    int is_good = file_exists(cert_path) && file_exists(key_path) && load(cert_path, &there, NULL) == STATUS_OK &&
                  is_key_of(there, key_path) && is_good_for(there, name);

    X509_free(there);
    *made = !is_good;
    return is_good ? STATUS_OK : make(cert_path, key_path, name, err);
}

status certificate_fingerprint(const char *cert_path, char out[FINGERPRINT_SIZE], struct error *err)
{
    unsigned char digest[EVP_MAX_MD_SIZE];
    unsigned size = 0;
    X509 *certificate;
    status s = load(cert_path, &certificate, err);

    out[0] = 0;
    if (s == STATUS_OK && X509_digest(certificate, EVP_sha256(), digest, &size) != 1)
        s = error_set(err, STATUS_ERR_INTERNAL, "%s: OpenSSL computed no fingerprint", cert_path);
    for (unsigned i = 0; s == STATUS_OK && i < size; i++)
        snprintf(out + 3 * i, 4, i + 1 < size ? "%02X:" : "%02X", digest[i]);
    X509_free(certificate);
    return s;
}
