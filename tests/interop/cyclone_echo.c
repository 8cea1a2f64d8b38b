/* The reference for the round trip in C: CycloneDDS receives displacement and publishes a force_estimate with the same stamp, and does
 * nothing else. Like tests/src/bin/echo_peer.rs it also receives coil_current and measured_force, and discards them.
 *
 * usage: cyclone_echo        with ROS_DOMAIN_ID and CYCLONEDDS_URI; ends on SIGINT and SIGTERM
 */
#include <dds/dds.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include "mr_damper.h"

#define DISPLACEMENT mr_damper_msgs_msg_dds__Displacement_
#define ESTIMATE mr_damper_msgs_msg_dds__ForceEstimate_

enum { BATCH = 64 };

static dds_entity_t guard;

static void end(int signal) {
  (void)signal;
  dds_set_guardcondition(guard, true);
}

/* Returns the entity, or ends the program with a message that names what could not be created. */
static dds_entity_t must(dds_entity_t entity, const char *what) {
  if (entity < 0) {
    fprintf(stderr, "cyclone_echo: %s: %s\n", what, dds_strretcode(-entity));
    exit(1);
  }
  return entity;
}

static dds_entity_t reader(dds_entity_t participant, const dds_topic_descriptor_t *type, const char *name) {
  dds_qos_t *qos = dds_create_qos();
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 256);
  dds_entity_t topic = must(dds_create_topic(participant, type, name, NULL, NULL), name);
  dds_entity_t made = must(dds_create_reader(participant, topic, qos, NULL), name);
  dds_delete_qos(qos);
  return made;
}

/* Takes all available samples; calls `each` for samples with data. */
static void take(dds_entity_t from, dds_entity_t answer, void (*each)(const void *, dds_entity_t)) {
  void *samples[BATCH] = {NULL};
  dds_sample_info_t infos[BATCH];
  int count;
  while ((count = dds_take(from, samples, infos, BATCH, BATCH)) > 0) {
    for (int k = 0; k < count; k++)
      if (infos[k].valid_data && each) each(samples[k], answer);
    dds_return_loan(from, samples, count);
  }
}

static void echo(const void *sample, dds_entity_t answer) {
  const DISPLACEMENT *displacement = sample;
  ESTIMATE estimate = {.header = displacement->header, .model = ""};
  dds_return_t result = dds_write(answer, &estimate);
  if (result < 0) fprintf(stderr, "cyclone_echo: an estimate was not sent: %s\n", dds_strretcode(-result));
}

int main(void) {
  const char *domain = getenv("ROS_DOMAIN_ID");
  dds_entity_t participant = must(dds_create_participant(domain ? (dds_domainid_t)atoi(domain) : 0, NULL, NULL), "participant");
  dds_entity_t displacement = reader(participant, &mr_damper_msgs_msg_dds__Displacement__desc, "rt/displacement");
  dds_entity_t current = reader(participant, &mr_damper_msgs_msg_dds__CoilCurrent__desc, "rt/coil_current");
  dds_entity_t force = reader(participant, &mr_damper_msgs_msg_dds__Force__desc, "rt/measured_force");
  dds_entity_t topic =
      must(dds_create_topic(participant, &mr_damper_msgs_msg_dds__ForceEstimate__desc, "rt/force_estimate", NULL, NULL), "topic");
  dds_qos_t *qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
  dds_entity_t answer = must(dds_create_writer(participant, topic, qos, NULL), "writer");
  dds_delete_qos(qos);

  guard = must(dds_create_guardcondition(participant), "guard condition");
  dds_entity_t waits = must(dds_create_waitset(participant), "waitset");
  dds_entity_t readers[] = {displacement, current, force};
  for (int k = 0; k < 3; k++) {
    must(dds_set_status_mask(readers[k], DDS_DATA_AVAILABLE_STATUS), "status mask");
    must(dds_waitset_attach(waits, readers[k], k), "waitset");
  }
  must(dds_waitset_attach(waits, guard, -1), "waitset");
  signal(SIGINT, end);
  signal(SIGTERM, end);
  bool over = false;
  while (!over) {
    dds_waitset_wait(waits, NULL, 0, DDS_INFINITY);
    take(displacement, answer, echo);
    take(current, answer, NULL);
    take(force, answer, NULL);
    dds_read_guardcondition(guard, &over);
  }
  dds_delete(participant);
  return 0;
}
