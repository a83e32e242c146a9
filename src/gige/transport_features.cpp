// What the transport adds to the camera's features: standard names over bootstrap registers, and fault
// injection.

#include "gige/control.hpp"

#include <algorithm>
#include <utility>

namespace atomcam::gige {
namespace {

constexpr const char* layer = "GigEVision";
constexpr const char* faults = "TransportFaults";

FeatureDeclaration number(std::string name, const char* category, std::uint32_t address, Access access,
                          double minimum, double maximum, std::string tooltip, std::string unit = "") {
  FeatureDeclaration feature;
  feature.name = std::move(name);
  feature.category = category;
  feature.type = FeatureType::integer;
  feature.access = access;
  feature.visibility = Visibility::expert;
  feature.tooltip = std::move(tooltip);
  feature.unit = std::move(unit);
  feature.minimum = minimum;
  feature.maximum = maximum;
  feature.increment = 1;
  feature.address = address;
  feature.length = 4;
  feature.custom = category == faults;
  return feature;
}

FeatureDeclaration bits(FeatureDeclaration feature, int lsb, int msb) {
  feature.lsb = lsb;
  feature.msb = msb;
  return feature;
}

}  // namespace

std::vector<FeatureDeclaration> transport_features(const InterfaceDescription& interface,
                                                   std::uint32_t default_packet_bytes) {
  const auto read = Access::read_only, both = Access::read_write;
  constexpr double word = 4294967295.0;
  std::vector<FeatureDeclaration> features = {
      bits(number("GevVersionMajor", layer, reg::version, read, 0, 65535, "Major version of the protocol."),
           16, 31),
      bits(number("GevVersionMinor", layer, reg::version, read, 0, 65535, "Minor version of the protocol."),
           0, 15),
      number("GevCurrentIPAddress", layer, reg::current_ip, read, 0, word, "IPv4 address of the device."),
      number("GevCurrentSubnetMask", layer, reg::current_mask, read, 0, word, "Subnet mask of the device."),
      number("GevCurrentDefaultGateway", layer, reg::current_gateway, read, 0, word, "Default gateway."),
      number("GevPersistentIPAddress", layer, reg::persistent_ip, both, 0, word,
             "Kept for clients that write it; the address is the host's."),
      number("GevPersistentSubnetMask", layer, reg::persistent_mask, both, 0, word,
             "See GevPersistentIPAddress."),
      number("GevPersistentDefaultGateway", layer, reg::persistent_gateway, both, 0, word,
             "See GevPersistentIPAddress."),
      number("GevLinkSpeed", layer, reg::link_speed, read, 0, word, "Speed of the link.", "Mbps"),
      number("GevMessageChannelCount", layer, reg::message_channels, read, 0, 1,
             "Number of message channels."),
      number("GevStreamChannelCount", layer, reg::stream_channels, read, 0, 1, "Number of stream channels."),
      number("GevHeartbeatTimeout", layer, reg::heartbeat, both, 500, word,
             "Silence of the controlling application after which the camera is freed.", "ms"),
      number("GevTimestampTickFrequency", layer, reg::tick_low, read, 1, word,
             "Ticks of the timestamp per second.", "Hz"),
      bits(number("GevSCPHostPort", layer, reg::stream_port, both, 0, 65535,
                  "UDP port that the stream goes to."),
           0, 15),
      number("GevSCDA", layer, reg::stream_address, both, 0, word, "IPv4 address that the stream goes to."),
      number("GevSCSP", layer, reg::stream_source, read, 0, 65535, "UDP port that the stream comes from."),
      number("GevSCPD", layer, reg::packet_delay, both, 0, 1e9, "Pause after every packet.", "ns"),
  };
  FeatureDeclaration size = bits(number("GevSCPSPacketSize", layer, reg::packet_size, both, 220,
                                        std::min<std::uint32_t>(interface.mtu, 65532) / 4 * 4,
                                        "Size of a stream packet, IP header included.", "B"),
                                 0, 15);
  size.increment = 4;
  size.default_value = default_packet_bytes;
  features.push_back(size);
  FeatureDeclaration fire = bits(number("GevSCPSFireTestPacket", layer, reg::packet_size, both, 0, 1,
                                        "Sends one packet of the size set; reads back 0."),
                                 31, 31);
  fire.type = FeatureType::boolean;
  features.push_back(fire);
  FeatureDeclaration fragment = bits(number("GevSCPSDoNotFragment", layer, reg::packet_size, both, 0, 1,
                                            "Stream packets are not to be fragmented on their way."),
                                     30, 30);
  fragment.type = FeatureType::boolean;
  fragment.default_value = 1;
  features.push_back(fragment);
  features.push_back(number("FaultPacketLoss", faults, reg::fault_loss_ppm, both, 0, 1e6,
                            "Probability that a stream packet is lost, in millionths.", "ppm"));
  features.push_back(number("FaultPacketLossBurst", faults, reg::fault_burst, both, 1, 10000,
                            "Packets lost in a row whenever one is lost."));
  features.push_back(number("FaultPacketReorder", faults, reg::fault_reorder_ppm, both, 0, 1e6,
                            "Probability that a packet changes places with the next, in millionths.", "ppm"));
  features.push_back(number("FaultPacketDuplicate", faults, reg::fault_duplicate_ppm, both, 0, 1e6,
                            "Probability that a packet is sent twice, in millionths.", "ppm"));
  features.push_back(number("FaultFrameDelayed", faults, reg::fault_delay_ppm, both, 0, 1e6,
                            "Probability that a frame is held back, in millionths.", "ppm"));
  features.push_back(number("FaultFrameDelay", faults, reg::fault_delay_us, both, 0, 1e7,
                            "How long a delayed frame is held back.", "us"));
  features.push_back(number("FaultFrameDropped", faults, reg::fault_drop_frames_ppm, both, 0, 1e6,
                            "Probability that a frame is not sent at all, in millionths.", "ppm"));
  features.push_back(number("FaultSeed", faults, reg::fault_seed, both, 0, word,
                            "Seed of the faults: the same seed, the same faults."));
  return features;
}

}  // namespace atomcam::gige
