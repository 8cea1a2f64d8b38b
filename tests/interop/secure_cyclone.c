/* A sensor in a DDS domain with security, on CycloneDDS: sends displacements and a coil current, receives force estimates.
 *
 * usage: secure_cyclone ENCLAVE READERS WRITERS SECONDS      with ROS_DOMAIN_ID
 *
 * ENCLAVE is a directory of a keystore. Waits until this many READERS and WRITERS of others are matched, at most a minute, then
 * continues for SECONDS. Prints one line of JSON. Debian's CycloneDDS supports security; the CycloneDDS of the wheels does not.
 * Its own middleware enforces its permissions (see secure_peer.cpp for a peer that exceeds them).
 */
#include <dds/dds.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "mr_damper.h"

#define DISPLACEMENT mr_damper_msgs_msg_dds__Displacement_
#define CURRENT mr_damper_msgs_msg_dds__CoilCurrent_
#define ESTIMATE mr_damper_msgs_msg_dds__ForceEstimate_

enum { BATCH = 64, MOST = 100000, PERIOD_MS = 10, PATIENCE = 60000 / PERIOD_MS };

static dds_time_t sent[MOST];
static int count_sent, heard, known;
static double largest;

/* Returns the entity, or ends the program with a message that names what could not be created. */
static dds_entity_t must(dds_entity_t entity, const char *what) {
  if (entity < 0) {
    fprintf(stderr, "secure_cyclone: %s: %s\n", what, dds_strretcode(-entity));
    exit(1);
  }
  return entity;
}

static void file(dds_qos_t *qos, const char *property, const char *enclave, const char *name) {
  char path[4096];
  snprintf(path, sizeof path, "file:%s/%s", enclave, name);
  dds_qset_prop(qos, property, path);
}

static void plugin(dds_qos_t *qos, const char *kind, const char *library, const char *verb) {
  char property[128], value[128];
  snprintf(property, sizeof property, "dds.sec.%s.library.path", kind);
  dds_qset_prop(qos, property, library);
  snprintf(property, sizeof property, "dds.sec.%s.library.init", kind);
  snprintf(value, sizeof value, "init_%s", verb);
  dds_qset_prop(qos, property, value);
  snprintf(property, sizeof property, "dds.sec.%s.library.finalize", kind);
  snprintf(value, sizeof value, "finalize_%s", verb);
  dds_qset_prop(qos, property, value);
}

/* The properties that rmw_cyclonedds sets. */
static dds_qos_t *secured(const char *enclave) {
  dds_qos_t *qos = dds_create_qos();
  plugin(qos, "auth", "dds_security_auth", "authentication");
  plugin(qos, "crypto", "dds_security_crypto", "crypto");
  plugin(qos, "access", "dds_security_ac", "access_control");
  file(qos, "dds.sec.auth.identity_ca", enclave, "identity_ca.cert.pem");
  file(qos, "dds.sec.auth.identity_certificate", enclave, "cert.pem");
  file(qos, "dds.sec.auth.private_key", enclave, "key.pem");
  file(qos, "dds.sec.access.permissions_ca", enclave, "permissions_ca.cert.pem");
  file(qos, "dds.sec.access.governance", enclave, "governance.p7s");
  file(qos, "dds.sec.access.permissions", enclave, "permissions.p7s");
  return qos;
}

static dds_time_t nanoseconds(const builtin_interfaces_msg_dds__Time_ *stamp) {
  return stamp->sec * DDS_NSECS_IN_SEC + stamp->nanosec;
}

static void hear(const ESTIMATE *estimate) {
  heard++;
  const dds_time_t stamp = nanoseconds(&estimate->header.stamp);
  for (int k = count_sent - 1; k >= 0; k--) {
    if (sent[k] == stamp) {
      known++;
      break;
    }
  }
  if (isfinite(estimate->force)) largest = fmax(largest, fabs(estimate->force));
}

static void take(dds_entity_t reader) {
  void *samples[BATCH] = {NULL};
  dds_sample_info_t infos[BATCH];
  int count;
  while ((count = dds_take(reader, samples, infos, BATCH, BATCH)) > 0) {
    for (int k = 0; k < count; k++)
      if (infos[k].valid_data) hear(samples[k]);
    dds_return_loan(reader, samples, count);
  }
}

static void send(dds_entity_t displacement, dds_entity_t current) {
  if (count_sent == MOST) return;
  const dds_time_t now = dds_time();
  const std_msgs_msg_dds__Header_ header = {
      .stamp = {.sec = (int32_t)(now / DDS_NSECS_IN_SEC), .nanosec = (uint32_t)(now % DDS_NSECS_IN_SEC)}, .frame_id = ""};
  const CURRENT amperes = {.header = header, .current = 1.0};
  const DISPLACEMENT sample = {.header = header, .displacement = 0.01 * sin(0.1 * count_sent)};
  sent[count_sent++] = now;
  dds_return_t result = dds_write(current, &amperes);
  if (result == DDS_RETCODE_OK) result = dds_write(displacement, &sample);
  if (result < 0) fprintf(stderr, "secure_cyclone: a sample was not sent: %s\n", dds_strretcode(-result));
}

int main(int count, char **words) {
  if (count != 5) {
    fputs("usage: secure_cyclone ENCLAVE READERS WRITERS SECONDS\n", stderr);
    return 2;
  }
  const uint32_t readers_wanted = (uint32_t)atoi(words[2]), writers_wanted = (uint32_t)atoi(words[3]);
  const char *domain = getenv("ROS_DOMAIN_ID");
  dds_qos_t *security = secured(words[1]);
  dds_entity_t participant = must(dds_create_participant(domain ? (dds_domainid_t)atoi(domain) : 0, security, NULL), "participant");
  dds_delete_qos(security);

  dds_entity_t in = must(dds_create_topic(participant, &mr_damper_msgs_msg_dds__Displacement__desc, "rt/displacement", NULL, NULL), "displacement");
  dds_entity_t drive = must(dds_create_topic(participant, &mr_damper_msgs_msg_dds__CoilCurrent__desc, "rt/coil_current", NULL, NULL), "coil_current");
  dds_entity_t out = must(dds_create_topic(participant, &mr_damper_msgs_msg_dds__ForceEstimate__desc, "rt/force_estimate", NULL, NULL), "force_estimate");
  dds_qos_t *qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 1000);
  dds_entity_t displacement = must(dds_create_writer(participant, in, qos, NULL), "writer of displacement");
  dds_entity_t current = must(dds_create_writer(participant, drive, qos, NULL), "writer of coil_current");
  dds_entity_t estimate = must(dds_create_reader(participant, out, qos, NULL), "reader of force_estimate");
  dds_delete_qos(qos);

  dds_publication_matched_status_t readers = {0};
  dds_subscription_matched_status_t writers = {0};
  int waited = 0, left = atoi(words[4]) * 1000 / PERIOD_MS;
  while (left > 0) {
    must(dds_get_publication_matched_status(displacement, &readers), "readers");
    must(dds_get_subscription_matched_status(estimate, &writers), "writers");
    const bool matched = readers.total_count >= readers_wanted && writers.total_count >= writers_wanted;
    if (matched || waited == PATIENCE) left--;
    else waited++;
    send(displacement, current);
    dds_sleepfor(DDS_MSECS(PERIOD_MS));
    take(estimate);
  }
  printf("{\"matched_after_s\": %g, \"sent\": %d, \"heard\": %d, \"known\": %d, \"largest_force_n\": %g, \"readers\": %u, \"writers\": %u}\n",
         waited * PERIOD_MS / 1000.0, count_sent, heard, known, largest, readers.total_count, writers.total_count);
  dds_delete(participant);
  return 0;
}
