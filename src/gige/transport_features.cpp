#include "gige/transport_features.hpp"

#include "gige/bootstrap.hpp"
#include "gige/control_handler.hpp"

namespace atomcam::gige {

namespace {

constexpr double whole_word = 4294967295.0;

class List {
 public:
  explicit List(std::string category) : category_(std::move(category)) {}

  FeatureDeclaration& add(FeatureType type, std::string name, std::string tooltip, std::uint32_t address,
                          Access access) {
    FeatureDeclaration declaration;
    declaration.name = std::move(name);
    declaration.category = category_;
    declaration.type = type;
    declaration.access = access;
    declaration.visibility = Visibility::expert;
    declaration.tooltip = std::move(tooltip);
    declaration.address = address;
    declaration.length = 4;
    features_.push_back(std::move(declaration));
    return features_.back();
  }
  FeatureDeclaration& integer(std::string name, std::string tooltip, std::uint32_t address, Access access,
                              double minimum = 0, double maximum = whole_word) {
    FeatureDeclaration& declaration =
        add(FeatureType::integer, std::move(name), std::move(tooltip), address, access);
    declaration.minimum = minimum;
    declaration.maximum = maximum;
    return declaration;
  }
  FeatureDeclaration& flag(std::string name, std::string tooltip, std::uint32_t address, int position,
                           Access access) {
    FeatureDeclaration& declaration =
        add(FeatureType::boolean, std::move(name), std::move(tooltip), address, access);
    declaration.lsb = declaration.msb = position;
    return declaration;
  }
  FeatureDeclaration& fault(std::string name, std::string tooltip, std::uint32_t address, double minimum,
                            double maximum, std::string unit, double value) {
    FeatureDeclaration& declaration =
        integer(std::move(name), std::move(tooltip), address, Access::read_write, minimum, maximum);
    declaration.unit = std::move(unit);
    declaration.default_value = value;
    declaration.custom = true;
    return declaration;
  }

  void category(std::string name) { category_ = std::move(name); }
  std::vector<FeatureDeclaration> take() { return std::move(features_); }

 private:
  std::string category_;
  std::vector<FeatureDeclaration> features_;
};

void field(FeatureDeclaration& declaration, int lsb, int msb) {
  declaration.lsb = lsb;
  declaration.msb = msb;
}

void unit(FeatureDeclaration& declaration, std::string name) {
  declaration.unit = std::move(name);
}

}  // namespace

std::vector<FeatureDeclaration> transport_features(std::uint32_t smallest_packet_bytes,
                                                   std::uint32_t largest_packet_bytes) {
  using enum Access;
  List list("TransportLayerControl");
  field(list.integer("GevVersionMajor", "Major version of the protocol.", reg::version, read_only, 0, 0xffff),
        16, 31);
  field(list.integer("GevVersionMinor", "Minor version of the protocol.", reg::version, read_only, 0, 0xffff),
        0, 15);
  list.flag("GevDeviceModeIsBigEndian", "Whether registers are big endian.", reg::device_mode, 31, read_only);
  field(list.integer("GevDeviceModeCharacterSet", "Character set of the strings; 1: UTF-8.", reg::device_mode,
                     read_only, 0, 15),
        0, 3);
  FeatureDeclaration& mac =
      list.integer("GevMACAddress", "Hardware address.", reg::mac_high, read_only, 0, 0);
  mac.length = 8;
  list.flag("GevCurrentIPConfigurationLLA", "Whether a link-local address may be taken.",
            reg::ip_configuration, 2, read_only);
  list.flag("GevCurrentIPConfigurationDHCP", "Whether DHCP is asked for an address.", reg::ip_configuration,
            1, read_write);
  list.flag("GevCurrentIPConfigurationPersistentIP", "Whether the persistent address is taken.",
            reg::ip_configuration, 0, read_write);
  list.integer("GevCurrentIPAddress", "Address of the device.", reg::current_ip, read_only);
  list.integer("GevCurrentSubnetMask", "Mask of its subnet.", reg::subnet_mask, read_only);
  list.integer("GevCurrentDefaultGateway", "Gateway of its subnet.", reg::gateway, read_only);
  list.integer("GevPersistentIPAddress", "Address kept for the next start.", reg::persistent_ip, read_write);
  list.integer("GevPersistentSubnetMask", "Mask kept for the next start.", reg::persistent_mask, read_write);
  list.integer("GevPersistentDefaultGateway", "Gateway kept for the next start.", reg::persistent_gateway,
               read_write);
  unit(list.integer("GevLinkSpeed", "Speed of the link.", reg::link_speed, read_only), "Mbps");
  list.integer("GevNumberOfInterfaces", "Number of network interfaces.", reg::interfaces, read_only);
  list.integer("GevMessageChannelCount", "Number of message channels.", reg::message_channels, read_only);
  list.integer("GevStreamChannelCount", "Number of stream channels.", reg::stream_channels, read_only);
  FeatureDeclaration& heartbeat =
      list.integer("GevHeartbeatTimeout", "Silence after which the client in control is taken for gone.",
                   reg::heartbeat_timeout, read_write, shortest_heartbeat_ms);
  unit(heartbeat, "ms");
  heartbeat.default_value = 3000;
  FeatureDeclaration& frequency =
      list.integer("GevTimestampTickFrequency", "Ticks of the device's clock in a second.",
                   reg::tick_frequency_high, read_only, 0, 0);
  frequency.length = 8;
  unit(frequency, "Hz");
  list.add(FeatureType::command, "GevTimestampControlLatch", "Latches the device's clock.",
           reg::timestamp_control, write_only)
      .default_value = 2;
  list.add(FeatureType::command, "GevTimestampControlReset", "Sets the device's clock to zero.",
           reg::timestamp_control, write_only)
      .default_value = 1;
  FeatureDeclaration& latched =
      list.integer("GevTimestampValue", "The latched clock.", reg::timestamp_high, read_only, 0, 0);
  latched.length = 8;
  unit(latched, "ns");
  FeatureDeclaration& control =
      list.add(FeatureType::enumeration, "GevCCP", "Who may control the device.", reg::control, read_write);
  control.entries = {{"OpenAccess", 0, "nobody is in control"},
                     {"ExclusiveAccess", 1, "one client reads and writes"},
                     {"ControlAccess", 2, "one client writes, others read"}};
  field(control, 0, 1);
  list.integer("GevPrimaryApplicationIPAddress", "Address of the client in control.", reg::controller_ip,
               read_only);
  list.integer("GevPrimaryApplicationSocket", "Port of the client in control.", reg::controller_port,
               read_only);
  list.flag("GevGVCPHeartbeatDisable", "Whether a silent client keeps control.", reg::gvcp_configuration, 0,
            read_write);
  list.flag("GevGVCPPendingAck", "Whether the client is told when a command takes long.",
            reg::gvcp_configuration, 1, read_write);
  FeatureDeclaration& ids =
      list.add(FeatureType::enumeration, "GevGVSPExtendedIDMode", "Width of the block and packet ids.",
               reg::gvsp_configuration, read_write);
  ids.entries = {{"Off", 0, "16-bit blocks, 24-bit packets"}, {"On", 1, "64-bit blocks, 32-bit packets"}};
  field(ids, 30, 30);
  list.integer("GevMCPHostPort", "Port that messages go to; 0 closes the channel.", reg::message_port,
               read_write, 0, 0xffff);
  list.integer("GevMCDA", "Address that messages go to.", reg::message_address, read_write);
  unit(list.integer("GevMCTT", "Time within which a message is to be acknowledged; 0: not at all.",
                    reg::message_timeout, read_write),
       "ms");
  list.integer("GevMCRC", "How often a message is sent again.", reg::message_retries, read_write, 0, 255);
  list.integer("GevMCSP", "Port that messages come from.", reg::message_source_port, read_only, 0, 0xffff);
  field(list.integer("GevSCPInterfaceIndex", "Interface of the stream.", reg::stream_port, read_only, 0, 0),
        16, 19);
  field(list.integer("GevSCPHostPort", "Port that frames go to; 0 closes the channel.", reg::stream_port,
                     read_write, 0, 0xffff),
        0, 15);
  field(list.add(FeatureType::command, "GevSCPSFireTestPacket", "Sends one packet of the set size.",
                 reg::stream_packet_size, read_write),
        31, 31);
  list.flag("GevSCPSDoNotFragment", "Whether packets may not be cut into fragments on their way.",
            reg::stream_packet_size, 30, read_write);
  FeatureDeclaration& size =
      list.integer("GevSCPSPacketSize", "Size of a packet, headers of IP and UDP included.",
                   reg::stream_packet_size, read_write, smallest_packet_bytes, largest_packet_bytes);
  size.increment = packet_bytes_step;
  unit(size, "B");
  field(size, 0, 15);
  list.integer("GevSCPD", "Pause between two packets, in ticks of the device's clock.", reg::stream_delay,
               read_write, 0, largest_delay_ns);
  list.integer("GevSCDA", "Address that frames go to.", reg::stream_address, read_write);
  list.integer("GevSCSP", "Port that frames come from.", reg::stream_source_port, read_only, 0, 0xffff);

  list.category("TransportFaults");
  constexpr double all = 1e6;
  list.fault("FaultPacketLoss", "Share of packets that are lost on purpose.", reg::fault_loss, 0, all, "ppm",
             0);
  list.fault("FaultPacketLossBurst", "Packets that are lost in a row.", reg::fault_burst, 1, 1000, "", 1);
  list.fault("FaultPacketReorder", "Share of packets that are sent late, after those that follow.",
             reg::fault_reorder, 0, all, "ppm", 0);
  list.fault("FaultPacketDuplicate", "Share of packets that are sent twice.", reg::fault_duplicate, 0, all,
             "ppm", 0);
  list.fault("FaultFrameDelayed", "Share of frames that are held back.", reg::fault_delayed_frames, 0, all,
             "ppm", 0);
  list.fault("FaultFrameDelay", "How long frames are held back.", reg::fault_delay_us, 0, 1e7, "us", 50'000);
  list.fault("FaultFrameDropped", "Share of frames that are not sent.", reg::fault_dropped_frames, 0, all,
             "ppm", 0);
  list.fault("FaultSeed", "Seed of the faults: the same seed, the same faults.", reg::fault_seed, 0,
             whole_word, "", 1);
  const auto counter = [&](std::string name, std::string tooltip, std::uint32_t address) {
    list.integer(std::move(name), std::move(tooltip), address, read_only).custom = true;
  };
  counter("StreamResendRequests", "Requests for packets, since the start.", reg::resend_requests);
  counter("StreamResentPackets", "Packets sent again, since the start.", reg::resent_packets);
  counter("StreamUnavailablePackets", "Packets asked for too late, since the start.",
          reg::unavailable_packets);
  counter("StreamDroppedFrames", "Frames that the sender had no time for, since the start.",
          reg::dropped_frames);
  return list.take();
}

}  // namespace atomcam::gige
