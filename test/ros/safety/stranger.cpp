// One writer or reader of `rt/axis/command` with Fast DDS itself, with or without an enclave of a keystore.
//
//   stranger write|read DOMAIN SECONDS [ENCLAVE]
//
// A reader ends with the first message, and prints how many came. It is C++, since the wheels' Fast DDS has no security plugins and Python has
// no other; the enclave is what `./microstage security` makes, passed to the plugins as rmw_fastrtps does.

#include <chrono>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <iostream>
#include <string>
#include <thread>
#include <unistd.h>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>

using namespace eprosima::fastdds::dds;

// Eight bytes, of which nobody asks what they mean.
class Bytes : public TopicDataType
{
public:
    Bytes()
    {
        setName("microstage_msgs::msg::dds_::VoltageCommand_");
        m_typeSize = 12;
        m_isGetKeyDefined = false;
    }

    bool serialize(void* data, eprosima::fastrtps::rtps::SerializedPayload_t* payload) override
    {
        const unsigned char head[4] = {0, 1, 0, 0};
        std::memcpy(payload->data, head, 4);
        std::memcpy(payload->data + 4, data, 8);
        payload->length = 12;
        return true;
    }

    bool deserialize(eprosima::fastrtps::rtps::SerializedPayload_t* payload, void* data) override
    {
        std::memcpy(data, payload->data + 4, 8);
        return true;
    }

    std::function<uint32_t()> getSerializedSizeProvider(void*) override { return [] { return 12u; }; }
    void* createData() override { return std::malloc(8); }
    void deleteData(void* data) override { std::free(data); }
    bool getKey(void*, eprosima::fastrtps::rtps::InstanceHandle_t*, bool) override { return false; }
};

void secure(DomainParticipantQos& qos, const std::string& enclave)
{
    auto set = [&](const std::string& name, const std::string& value)
    {
        qos.properties().properties().emplace_back(name, value);
    };
    const std::string at = "file://" + enclave + "/";
    set("dds.sec.auth.plugin", "builtin.PKI-DH");
    set("dds.sec.auth.builtin.PKI-DH.identity_ca", at + "identity_ca.cert.pem");
    set("dds.sec.auth.builtin.PKI-DH.identity_certificate", at + "cert.pem");
    set("dds.sec.auth.builtin.PKI-DH.private_key", at + "key.pem");
    set("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
    set("dds.sec.access.plugin", "builtin.Access-Permissions");
    set("dds.sec.access.builtin.Access-Permissions.permissions_ca", at + "permissions_ca.cert.pem");
    set("dds.sec.access.builtin.Access-Permissions.governance", at + "governance.p7s");
    set("dds.sec.access.builtin.Access-Permissions.permissions", at + "permissions.p7s");
}

int main(int count, char** words)
{
    if (count < 4)
    {
        std::cerr << "stranger write|read DOMAIN SECONDS [ENCLAVE]" << std::endl;
        return 2;
    }
    const bool writes = std::string(words[1]) == "write";
    DomainParticipantQos qos;
    if (count > 4)
    {
        secure(qos, words[4]);
    }
    auto* participant = DomainParticipantFactory::get_instance()->create_participant(std::atoi(words[2]), qos);
    if (participant == nullptr)
    {
        std::cout << "no participant" << std::endl;
        return 0;
    }
    TypeSupport type(new Bytes());
    type.register_type(participant);
    auto* topic = participant->create_topic("rt/axis/command", type.get_type_name(), TOPIC_QOS_DEFAULT);
    DataWriter* writer = nullptr;
    DataReader* reader = nullptr;
    if (writes)
    {
        writer = participant->create_publisher(PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, DATAWRITER_QOS_DEFAULT);
    }
    else
    {
        reader = participant->create_subscriber(SUBSCRIBER_QOS_DEFAULT)->create_datareader(topic, DATAREADER_QOS_DEFAULT);
    }
    if (writer == nullptr && reader == nullptr)
    {
        std::cout << "no endpoint" << std::endl;
        return 0;
    }
    std::cout << "ready" << std::endl;
    int came = 0;
    const auto end = std::chrono::steady_clock::now() + std::chrono::milliseconds(int(1000 * std::atof(words[3])));
    while (came == 0 && std::chrono::steady_clock::now() < end)
    {
        char data[8] = {};
        SampleInfo info;
        if (writes)
        {
            writer->write(data);
        }
        while (reader != nullptr && reader->take_next_sample(data, &info) == ReturnCode_t::RETCODE_OK)
        {
            came += info.valid_data ? 1 : 0;
        }
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    if (!writes)
    {
        std::cout << came << std::endl;
    }
    std::cout.flush();
    _exit(0);  // the participant goes with the process
}
