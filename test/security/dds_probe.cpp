// A DDS participant with or without keys that speaks or listens on one topic of this computer:
// dds_probe publish|subscribe TOPIC DOMAIN [ENCLAVE]. It says "open" or "refused: what", and "heard" for each sample.
#include <chrono>
#include <cstdlib>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/log/Log.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <thread>

using namespace eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::InstanceHandle_t;
using eprosima::fastrtps::rtps::SerializedPayload_t;

// One number, without a key: what is in a message does not matter here.
class NumberType : public TopicDataType {
public:
    NumberType() { setName("probe::Number"); m_typeSize = 8; m_isGetKeyDefined = false; }
    bool serialize(void* data, SerializedPayload_t* payload) override {
        std::memset(payload->data, 0, 8);
        std::memcpy(payload->data + 4, data, 4);
        payload->length = 8;
        return true;
    }
    bool deserialize(SerializedPayload_t* payload, void* data) override {
        std::memcpy(data, payload->data + 4, 4);
        return true;
    }
    std::function<uint32_t()> getSerializedSizeProvider(void*) override { return [] { return 8u; }; }
    void* createData() override { return new int32_t(0); }
    void deleteData(void* data) override { delete static_cast<int32_t*>(data); }
    bool getKey(void*, InstanceHandle_t*, bool) override { return false; }
};

static void give_keys(DomainParticipantQos& qos, const std::string& enclave) {
    auto& properties = qos.properties().properties();
    const std::string file = "file://" + enclave + "/";
    properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
    properties.emplace_back("dds.sec.auth.builtin.PKI-DH.identity_ca", file + "identity_ca.cert.pem");
    properties.emplace_back("dds.sec.auth.builtin.PKI-DH.identity_certificate", file + "cert.pem");
    properties.emplace_back("dds.sec.auth.builtin.PKI-DH.private_key", file + "key.pem");
    properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
    properties.emplace_back("dds.sec.access.builtin.Access-Permissions.permissions_ca", file + "permissions_ca.cert.pem");
    properties.emplace_back("dds.sec.access.builtin.Access-Permissions.governance", file + "governance.p7s");
    properties.emplace_back("dds.sec.access.builtin.Access-Permissions.permissions", file + "permissions.p7s");
    properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
}

static void say(const char* what) { std::cout << what << std::endl; }

// What the library leaves behind after a refusal does not matter here.
static int refuse(const char* what) {
    say(what);
    std::_Exit(0);
}

int main(int count, char** words) {
    Log::ClearConsumers();  // what the library logs would stand in the middle of what is said here
    const std::string role = words[1], name = words[2];
    const auto domain = static_cast<uint32_t>(std::stoul(words[3]));
    DomainParticipantQos qos;
    auto loopback = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
    loopback->interfaceWhiteList.emplace_back("127.0.0.1");
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(loopback);
    if (count > 4) give_keys(qos, words[4]);
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(domain, qos);
    if (participant == nullptr) return refuse("refused: participant");
    TypeSupport type(new NumberType());
    type.register_type(participant);
    auto* topic = participant->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
    if (topic == nullptr) return refuse("refused: topic");
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    if (role == "publish") {
        DataWriterQos writing;
        writing.reliability().kind = RELIABLE_RELIABILITY_QOS;
        auto* writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, writing);
        if (writer == nullptr) return refuse("refused: writer");
        say("open");
        for (int32_t number = 0; std::chrono::steady_clock::now() < end; ++number) {
            writer->write(&number);
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        }
        return 0;
    }
    DataReaderQos reading;
    reading.reliability().kind = RELIABLE_RELIABILITY_QOS;
    auto* reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, reading);
    if (reader == nullptr) return refuse("refused: reader");
    say("open");
    while (std::chrono::steady_clock::now() < end) {
        int32_t number = 0;
        SampleInfo info;
        if (reader->take_next_sample(&number, &info) == ReturnCode_t::RETCODE_OK && info.valid_data) say("heard");
        std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
    return 0;
}
