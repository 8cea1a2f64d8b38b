// A sensor in a DDS domain with security, on Fast DDS: sends displacements and a coil current, receives force estimates.
//
// usage: secure_peer ENCLAVE|none READERS WRITERS SECONDS
//
// ENCLAVE is a directory of a keystore. Waits until this many READERS and WRITERS of others are matched, at most a
// minute (a handshake takes some seconds, longer on a busy machine), then continues for SECONDS. Prints one line of
// JSON. Debian's Fast DDS supports security; the Fast DDS of the wheels does not. The types are written by hand, in
// XCDR1, as on any ROS 2 topic. This peer tries to exceed its permissions: the other side must refuse that.

#define HAVE_SECURITY 1
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <iostream>
#include <memory>
#include <set>
#include <string>
#include <thread>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/log/StdoutErrConsumer.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

using namespace eprosima::fastdds::dds;
using namespace eprosima::fastrtps::rtps;

int checks_left_out = 0;

// Replaces Fast DDS' own checks of what this participant may create, because a hostile peer would not run them.
extern "C" bool _ZN8eprosima8fastrtps4rtps8security11Permissions23check_create_datawriterERKNS2_6HandleEjRKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKSt6vectorISC_SaISC_EERNS2_17SecurityExceptionE(
    void*, const void*, uint32_t, const void*, const void*, void*) {
  checks_left_out++;
  return true;
}
extern "C" bool _ZN8eprosima8fastrtps4rtps8security11Permissions23check_create_datareaderERKNS2_6HandleEjRKNSt7__cxx1112basic_stringIcSt11char_traitsIcESaIcEEERKSt6vectorISC_SaISC_EERNS2_17SecurityExceptionE(
    void*, const void*, uint32_t, const void*, const void*, void*) {
  checks_left_out++;
  return true;
}

// Stamp and one value: the parts of Displacement, CoilCurrent and ForceEstimate that are used here.
struct Sample {
  int64_t nanoseconds = 0;
  double figure = 0.0;
};

class Type : public TopicDataType {
 public:
  explicit Type(const char* name) {
    setName(name);
    m_typeSize = 1024;
    m_isGetKeyDefined = false;
  }

  bool serialize(void* data, SerializedPayload_t* payload) override {
    const auto& sample = *static_cast<Sample*>(data);
    const uint32_t empty = 1;
    std::memset(payload->data, 0, 36);
    payload->data[1] = 1;  // little endian
    const auto seconds = static_cast<int32_t>(sample.nanoseconds / 1000000000);
    const auto rest = static_cast<uint32_t>(sample.nanoseconds % 1000000000);
    std::memcpy(payload->data + 4, &seconds, 4);
    std::memcpy(payload->data + 8, &rest, 4);
    std::memcpy(payload->data + 12, &empty, 4);  // frame_id
    std::memcpy(payload->data + 20, &sample.figure, 8);
    payload->length = 36;
    payload->encapsulation = CDR_LE;
    return true;
  }

  bool deserialize(SerializedPayload_t* payload, void* data) override {
    if (payload->length < 28) return false;
    auto& sample = *static_cast<Sample*>(data);
    int32_t seconds = 0;
    uint32_t rest = 0, frame = 0;
    std::memcpy(&seconds, payload->data + 4, 4);
    std::memcpy(&rest, payload->data + 8, 4);
    sample.nanoseconds = seconds * int64_t{1000000000} + rest;
    std::memcpy(&frame, payload->data + 12, 4);
    const uint32_t at = 4 + ((12 + frame + 7) & ~7u);
    if (frame > payload->length || at + 8 > payload->length) return false;
    std::memcpy(&sample.figure, payload->data + at, 8);
    return true;
  }

  std::function<uint32_t()> getSerializedSizeProvider(void*) override {
    return [] { return 36u; };
  }
  void* createData() override { return new Sample; }
  void deleteData(void* data) override { delete static_cast<Sample*>(data); }
  bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

struct Listener : DomainParticipantListener {
  int authorized = 0, unauthorized = 0;
  void onParticipantAuthentication(DomainParticipant*, ParticipantAuthenticationInfo&& info) override {
    (info.status == ParticipantAuthenticationInfo::AUTHORIZED_PARTICIPANT ? authorized : unauthorized)++;
  }
};

DomainParticipantQos participant_qos(const std::string& enclave) {
  DomainParticipantQos qos;
  qos.name("secure_peer");
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
  if (enclave == "none") return qos;
  auto& properties = qos.properties().properties();
  const auto file = [&](const std::string& name, const char* path) {
    properties.emplace_back(name, "file://" + enclave + "/" + path);
  };
  const std::string authentication = "dds.sec.auth.builtin.PKI-DH.";
  const std::string access = "dds.sec.access.builtin.Access-Permissions.";
  properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
  properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  file(authentication + "identity_ca", "identity_ca.cert.pem");
  file(authentication + "identity_certificate", "cert.pem");
  file(authentication + "private_key", "key.pem");
  file(access + "permissions_ca", "permissions_ca.cert.pem");
  file(access + "governance", "governance.p7s");
  file(access + "permissions", "permissions.p7s");
  return qos;
}

int main(int count, char** words) {
  if (count != 5) {
    std::cerr << "usage: secure_peer ENCLAVE|none READERS WRITERS SECONDS\n";
    return 2;
  }
  const int readers_wanted = std::atoi(words[2]), writers_wanted = std::atoi(words[3]);
  // Standard output is for the line of JSON. By default Fast DDS writes its errors there, too, for instance while it ends.
  Log::SetVerbosity(Log::Kind::Error);
  Log::ClearConsumers();
  auto errors = std::make_unique<StdoutErrConsumer>();
  errors->stderr_threshold(Log::Kind::Error);
  Log::RegisterConsumer(std::move(errors));
  Listener listener;
  const char* domain = std::getenv("ROS_DOMAIN_ID");
  auto* participant = DomainParticipantFactory::get_instance()->create_participant(
      domain ? std::atoi(domain) : 0, participant_qos(words[1]), &listener, StatusMask::none());
  if (!participant) {
    std::cerr << "secure_peer: the participant was refused\n";
    return 1;
  }
  TypeSupport in(new Type("mr_damper_msgs::msg::dds_::Displacement_"));
  TypeSupport drive(new Type("mr_damper_msgs::msg::dds_::CoilCurrent_"));
  TypeSupport out(new Type("mr_damper_msgs::msg::dds_::ForceEstimate_"));
  in.register_type(participant);
  drive.register_type(participant);
  out.register_type(participant);
  auto* displacement = participant->create_topic("rt/displacement", in.get_type_name(), TOPIC_QOS_DEFAULT);
  auto* current = participant->create_topic("rt/coil_current", drive.get_type_name(), TOPIC_QOS_DEFAULT);
  auto* estimate = participant->create_topic("rt/force_estimate", out.get_type_name(), TOPIC_QOS_DEFAULT);
  DataReaderQos reading = DATAREADER_QOS_DEFAULT;
  reading.reliability().kind = RELIABLE_RELIABILITY_QOS;
  reading.history().depth = 1000;
  auto* publisher = participant->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* writer = publisher->create_datawriter(displacement, DATAWRITER_QOS_DEFAULT);
  auto* driver = publisher->create_datawriter(current, DATAWRITER_QOS_DEFAULT);
  auto* reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(estimate, reading);
  if (std::string(words[1]) != "none" && checks_left_out != 3) {
    std::cerr << "secure_peer: Fast DDS ran its own checks (" << checks_left_out << " of 3 replaced); this program is written for 2.9\n";
    return 1;
  }
  if (!writer || !driver || !reader) {
    std::cerr << "secure_peer: its own middleware refused a " << (reader ? "writer" : "reader") << "\n";
    return 1;
  }

  std::set<int64_t> sent;
  int heard = 0, known = 0;
  double largest = 0.0;
  PublicationMatchedStatus readers;
  SubscriptionMatchedStatus writers;
  int waited = 0, left = std::atoi(words[4]) * 100;
  for (int k = 1; left > 0; k++) {
    writer->get_publication_matched_status(readers);
    reader->get_subscription_matched_status(writers);
    const bool matched = readers.total_count >= readers_wanted && writers.total_count >= writers_wanted;
    if (matched || waited == 6000) left--; else waited++;
    const auto now = std::chrono::system_clock::now().time_since_epoch();
    Sample sample{std::chrono::nanoseconds(now).count(), 0.01 * std::sin(0.1 * k)};
    Sample amperes{sample.nanoseconds, 1.0};
    driver->write(&amperes);
    if (writer->write(&sample)) sent.insert(sample.nanoseconds);
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    SampleInfo info;
    while (reader->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      heard++;
      known += sent.count(sample.nanoseconds);
      if (std::isfinite(sample.figure)) largest = std::max(largest, std::abs(sample.figure));
    }
  }
  std::cout << "{\"authorized\": " << listener.authorized << ", \"unauthorized\": " << listener.unauthorized
            << ", \"matched_after_s\": " << waited / 100.0
            << ", \"sent\": " << sent.size() << ", \"heard\": " << heard << ", \"known\": " << known
            << ", \"largest_force_n\": " << largest << ", \"readers\": " << readers.total_count
            << ", \"writers\": " << writers.total_count << "}" << std::endl;
  participant->delete_contained_entities();
  DomainParticipantFactory::get_instance()->delete_participant(participant);
}
