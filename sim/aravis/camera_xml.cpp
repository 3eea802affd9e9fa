#include "sim/aravis/camera_xml.h"

#include <fmt/format.h>

#include <string_view>

namespace lightrig::sim {
namespace {

std::string category(std::string_view name, std::initializer_list<std::string_view> features) {
  std::string xml = fmt::format("<Category Name=\"{}\" NameSpace=\"Standard\">\n", name);
  for (const auto feature : features) xml += fmt::format("  <pFeature>{}</pFeature>\n", feature);
  return xml + "</Category>\n";
}

std::string text_register(std::string_view name, std::uint32_t address, int length) {
  return fmt::format(
      "<StringReg Name=\"{}\" NameSpace=\"Standard\"><Address>{:#x}</Address><Length>{}</Length>"
      "<AccessMode>RO</AccessMode><pPort>Device</pPort></StringReg>\n",
      name, address, length);
}

std::string word_register(std::string_view name, std::uint32_t address, std::string_view access) {
  return fmt::format(
      "<IntReg Name=\"{}\" NameSpace=\"Custom\"><Address>{:#x}</Address><Length>4</Length>"
      "<AccessMode>{}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>"
      "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>\n",
      name, address, access);
}

/// One word for each value of a selector.
std::string indexed_register(std::string_view name, std::uint32_t address,
                             std::string_view selector) {
  return fmt::format(
      "<IntReg Name=\"{}\" NameSpace=\"Custom\"><Address>{:#x}</Address>"
      "<pIndex Offset=\"4\">{}</pIndex><Length>4</Length><AccessMode>RW</AccessMode>"
      "<pPort>Device</pPort><Cachable>NoCache</Cachable><Sign>Unsigned</Sign>"
      "<Endianess>BigEndian</Endianess></IntReg>\n",
      name, address, selector);
}

std::string integer(std::string_view name, std::uint32_t address, std::string_view access,
                    std::string_view limits = "") {
  return fmt::format(
             "<Integer Name=\"{}\" NameSpace=\"Standard\"><pValue>{}Reg</pValue>{}</Integer>\n",
             name, name, limits) +
         word_register(fmt::format("{}Reg", name), address, access);
}

/// What is left of a side of the sensor beside `used`, under a name of its own.
std::string rest_of(std::string_view name, std::string_view sensor, std::string_view used) {
  return fmt::format(
      "<IntSwissKnife Name=\"{}\" NameSpace=\"Custom\"><pVariable Name=\"SENSOR\">{}</pVariable>"
      "<pVariable Name=\"USED\">{}</pVariable><Formula>SENSOR - USED</Formula>"
      "</IntSwissKnife>\n",
      name, sensor, used);
}

std::string boolean(std::string_view name, std::uint32_t address) {
  return fmt::format(
             "<Boolean Name=\"{}\" NameSpace=\"Standard\"><pValue>{}Reg</pValue>"
             "<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>\n",
             name, name) +
         word_register(fmt::format("{}Reg", name), address, "RW");
}

std::string command(std::string_view name, std::uint32_t address, std::uint32_t value = 1) {
  return fmt::format(
             "<Command Name=\"{}\" NameSpace=\"Standard\"><pValue>{}Reg</pValue>"
             "<CommandValue>{}</CommandValue></Command>\n",
             name, name, value) +
         word_register(fmt::format("{}Reg", name), address, "WO");
}

std::string number(std::string_view name, std::uint32_t address, std::string_view unit,
                   double least, double most, std::string_view access = "RW") {
  return fmt::format(
      "<Float Name=\"{0}\" NameSpace=\"Standard\"><pValue>{0}Reg</pValue><Min>{1}</Min>"
      "<Max>{2}</Max><Unit>{3}</Unit></Float>\n"
      "<FloatReg Name=\"{0}Reg\" NameSpace=\"Custom\"><Address>{4:#x}</Address><Length>8</Length>"
      "<AccessMode>{5}</AccessMode><pPort>Device</pPort><Cachable>NoCache</Cachable>"
      "<Endianess>BigEndian</Endianess></FloatReg>\n",
      name, least, most, unit, address, access);
}

struct Entry {
  std::string_view name;
  std::uint32_t value;
};

template <class Entries>
std::string enumeration(std::string_view name, const Entries& entries, std::string_view source) {
  std::string xml = fmt::format("<Enumeration Name=\"{}\" NameSpace=\"Standard\">\n", name);
  for (const Entry& entry : entries)
    xml += fmt::format(
        "  <EnumEntry Name=\"{}\" NameSpace=\"Standard\"><Value>{}</Value></EnumEntry>\n",
        entry.name, entry.value);
  return xml + fmt::format("  {}\n</Enumeration>\n", source);
}

std::string choice(std::string_view name, std::uint32_t address,
                   const std::vector<Entry>& entries) {
  return enumeration(name, entries, fmt::format("<pValue>{}Reg</pValue>", name)) +
         word_register(fmt::format("{}Reg", name), address, "RW");
}

std::string device_control() {
  return category("DeviceControl",
                  {"DeviceVendorName", "DeviceModelName", "DeviceVersion", "DeviceManufacturerInfo",
                   "DeviceID", "DeviceSerialNumber", "DeviceReset", "TimestampLatch",
                   "TimestampLatchValue", "DeviceTemperature"}) +
         number("DeviceTemperature", reg_temperature, "C", -40, 125, "RO") +
         text_register("DeviceVendorName", 0x48, 32) + text_register("DeviceModelName", 0x68, 32) +
         text_register("DeviceVersion", 0x88, 32) +
         text_register("DeviceManufacturerInfo", 0xa8, 48) + text_register("DeviceID", 0xd8, 16) +
         text_register("DeviceSerialNumber", 0xd8, 16) + command("DeviceReset", reg_device_reset) +
         command("TimestampLatch", reg_timestamp_control, 2) +
         fmt::format(
             "<Integer Name=\"TimestampLatchValue\" NameSpace=\"Standard\">"
             "<pValue>TimestampLatchValueReg</pValue></Integer>\n"
             "<IntReg Name=\"TimestampLatchValueReg\" NameSpace=\"Custom\"><Address>{:#x}</Address>"
             "<Length>8</Length><AccessMode>RO</AccessMode><pPort>Device</pPort>"
             "<Cachable>NoCache</Cachable><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess>"
             "</IntReg>\n",
             static_cast<std::uint32_t>(reg_timestamp_high));
}

std::string image_format_control(const CameraBody& body) {
  std::vector<Entry> formats;
  for (const PixelFormat* format : offered_formats(body.filter))
    formats.push_back({format->name, format->code});
  const auto up_to = [](int least, std::string_view most) {
    return fmt::format("<Min>{}</Min><pMax>{}</pMax><Inc>1</Inc>", least, most);
  };
  return category("ImageFormatControl", {"SensorWidth", "SensorHeight", "Width", "Height",
                                         "OffsetX", "OffsetY", "ReverseX", "PixelFormat"}) +
         integer("SensorWidth", reg_sensor_width, "RO") +
         integer("SensorHeight", reg_sensor_height, "RO") +
         integer("Width", reg_width, "RW", up_to(least_size, "WidthMax")) +
         integer("Height", reg_height, "RW", up_to(least_size, "HeightMax")) +
         integer("OffsetX", reg_offset_x, "RW", up_to(0, "OffsetXMax")) +
         integer("OffsetY", reg_offset_y, "RW", up_to(0, "OffsetYMax")) +
         rest_of("WidthMax", "SensorWidthReg", "OffsetXReg") +
         rest_of("HeightMax", "SensorHeightReg", "OffsetYReg") +
         rest_of("OffsetXMax", "SensorWidthReg", "WidthReg") +
         rest_of("OffsetYMax", "SensorHeightReg", "HeightReg") +
         boolean("ReverseX", reg_reverse_x) + choice("PixelFormat", reg_pixel_format, formats);
}

std::string acquisition_control(const CameraBody& body) {
  return category("AcquisitionControl",
                  {"AcquisitionMode", "AcquisitionStart", "AcquisitionStop", "TriggerSelector",
                   "TriggerMode", "TriggerSource", "TriggerSoftware", "ExposureMode",
                   "ExposureTime", "AcquisitionFrameRateEnable", "AcquisitionFrameRate"}) +
         choice("AcquisitionMode", reg_acquisition_mode,
                {{"Continuous", continuous_mode}, {"SingleFrame", single_frame_mode}}) +
         command("AcquisitionStart", reg_acquisition_start) +
         command("AcquisitionStop", reg_acquisition_stop) +
         enumeration("TriggerSelector",
                     std::vector<Entry>{{"FrameStart", 0}, {"AcquisitionStart", 1}},
                     "<pValue>TriggerSelectorInteger</pValue>") +
         "<Integer Name=\"TriggerSelectorInteger\" NameSpace=\"Custom\"><Value>0</Value>"
         "</Integer>\n" +
         enumeration("TriggerMode", std::vector<Entry>{{"Off", 0}, {"On", 1}},
                     "<pValue>TriggerModeReg</pValue>") +
         indexed_register("TriggerModeReg", reg_trigger_mode, "TriggerSelectorInteger") +
         choice("TriggerSource", reg_trigger_source,
                {{"Software", software_source}, {"Line1", line_source}}) +
         command("TriggerSoftware", reg_trigger_software) +
         enumeration("ExposureMode", std::vector<Entry>{{"Timed", 0}}, "<Value>0</Value>") +
         number("ExposureTime", reg_exposure_time, "us", body.min_exposure * 1e6,
                body.max_exposure * 1e6) +
         boolean("AcquisitionFrameRateEnable", reg_frame_rate_enable) +
         number("AcquisitionFrameRate", reg_frame_rate, "Hz", least_frame_rate, most_frame_rate);
}

/// A register of a chunk: read from the frame's own data, through a port that carries the id.
std::string chunk_feature(std::string_view name, Chunk chunk, bool real) {
  const std::string_view kind = real ? "FloatReg" : "IntReg";
  return fmt::format(
      "<{0} Name=\"{1}\" NameSpace=\"Standard\"><Address>0</Address><Length>8</Length>"
      "<AccessMode>RO</AccessMode><pPort>{1}Port</pPort><Cachable>NoCache</Cachable>{2}"
      "<Endianess>BigEndian</Endianess></{0}>\n"
      "<Port Name=\"{1}Port\" NameSpace=\"Custom\"><ChunkID>{3:08x}</ChunkID></Port>\n",
      kind, name, real ? "" : "<Sign>Unsigned</Sign>", chunk_id(chunk));
}

std::string chunk_control() {
  const std::vector<Entry> chunks = {
      {"FrameID", 0}, {"ExposureTime", 1}, {"Timestamp", 2}, {"OffsetX", 3}, {"OffsetY", 4}};
  return category("ChunkDataControl",
                  {"ChunkModeActive", "ChunkSelector", "ChunkEnable", "ChunkFrameID",
                   "ChunkExposureTime", "ChunkTimestamp", "ChunkOffsetX", "ChunkOffsetY"}) +
         boolean("ChunkModeActive", reg_chunk_mode) +
         enumeration("ChunkSelector", chunks, "<pValue>ChunkSelectorInteger</pValue>") +
         "<Integer Name=\"ChunkSelectorInteger\" NameSpace=\"Custom\"><Value>0</Value></Integer>\n"
         "<Boolean Name=\"ChunkEnable\" NameSpace=\"Standard\"><pValue>ChunkEnableReg</pValue>"
         "<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>\n" +
         indexed_register("ChunkEnableReg", reg_chunk_enable, "ChunkSelectorInteger") +
         chunk_feature("ChunkFrameID", Chunk::frame_id, false) +
         chunk_feature("ChunkExposureTime", Chunk::exposure_time, true) +
         chunk_feature("ChunkTimestamp", Chunk::timestamp, false) +
         chunk_feature("ChunkOffsetX", Chunk::offset_x, false) +
         chunk_feature("ChunkOffsetY", Chunk::offset_y, false);
}

std::string transport_control() {
  return category("TransportLayerControl",
                  {"PayloadSize", "GevSCPSPacketSize", "GevSCPSFireTestPacket",
                   "GevSCPSDoNotFragment", "GevSCPD", "GevHeartbeatTimeout"}) +
         integer("PayloadSize", reg_payload_size, "RO") +
         fmt::format(
             "<Integer Name=\"GevSCPSPacketSize\" NameSpace=\"Standard\">"
             "<pValue>GevSCPSPacketSizeReg</pValue><Min>576</Min><Max>9000</Max><Inc>4</Inc>"
             "</Integer>\n"
             "<MaskedIntReg Name=\"GevSCPSPacketSizeReg\" NameSpace=\"Custom\">"
             "<Address>{0:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>"
             "<pPort>Device</pPort><Cachable>NoCache</Cachable><LSB>31</LSB><MSB>16</MSB>"
             "<Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></MaskedIntReg>\n"
             "<Command Name=\"GevSCPSFireTestPacket\" NameSpace=\"Standard\">"
             "<pValue>GevSCPSFireTestPacketReg</pValue><CommandValue>1</CommandValue></Command>\n"
             "<MaskedIntReg Name=\"GevSCPSFireTestPacketReg\" NameSpace=\"Custom\">"
             "<Address>{0:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>"
             "<pPort>Device</pPort><Cachable>NoCache</Cachable><Bit>0</Bit>"
             "<Endianess>BigEndian</Endianess></MaskedIntReg>\n"
             "<Boolean Name=\"GevSCPSDoNotFragment\" NameSpace=\"Standard\">"
             "<pValue>GevSCPSDoNotFragmentReg</pValue></Boolean>\n"
             "<MaskedIntReg Name=\"GevSCPSDoNotFragmentReg\" NameSpace=\"Custom\">"
             "<Address>{0:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>"
             "<pPort>Device</pPort><Cachable>NoCache</Cachable><Bit>1</Bit>"
             "<Endianess>BigEndian</Endianess></MaskedIntReg>\n",
             static_cast<std::uint32_t>(reg_packet_size)) +
         integer("GevSCPD", reg_packet_delay, "RW") +
         integer("GevHeartbeatTimeout", reg_heartbeat, "RW") +
         "<Integer Name=\"TLParamsLocked\" NameSpace=\"Standard\"><Visibility>Invisible"
         "</Visibility><Value>0</Value><Min>0</Min><Max>1</Max></Integer>\n";
}

}  // namespace

std::vector<const PixelFormat*> offered_formats(ColorFilter filter) {
  std::vector<const PixelFormat*> formats;
  for (const PixelFormat& format : pixel_formats())
    if (format.filter == filter) formats.push_back(&format);
  return formats;
}

std::string camera_xml(const CameraBody& body) {
  std::string xml =
      "<?xml version=\"1.0\" encoding=\"utf-8\"?>\n"
      "<RegisterDescription ModelName=\"Simulated\" VendorName=\"lightrig\" "
      "StandardNameSpace=\"GEV\" SchemaMajorVersion=\"1\" SchemaMinorVersion=\"0\" "
      "SchemaSubMinorVersion=\"1\" MajorVersion=\"1\" MinorVersion=\"0\" SubMinorVersion=\"0\" "
      "ToolTip=\"lightrig simulated camera\" "
      "ProductGuid=\"6c696768-7472-6967-0000-000000000001\" "
      "VersionGuid=\"6c696768-7472-6967-0000-000000000002\" "
      "xmlns=\"http://www.genicam.org/GenApi/Version_1_0\" "
      "xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" "
      "xsi:schemaLocation=\"http://www.genicam.org/GenApi/Version_1_0 GenApiSchema.xsd\">\n";
  xml += category("Root",
                  {"DeviceControl", "ImageFormatControl", "AcquisitionControl", "AnalogControl",
                   "UserSetControl", "ChunkDataControl", "TransportLayerControl"});
  xml += device_control() + image_format_control(body) + acquisition_control(body);
  xml += category("AnalogControl", {"Gain", "BlackLevel", "GammaEnable"}) +
         number("Gain", reg_gain, "dB", 0, most_gain) +
         number("BlackLevel", reg_black_level, "DN", 0, (1 << body.bits) - 1) +
         boolean("GammaEnable", reg_gamma_enable);
  xml += category("UserSetControl", {"UserSetSelector", "UserSetLoad"}) +
         enumeration("UserSetSelector", std::vector<Entry>{{"Default", 0}}, "<Value>0</Value>") +
         command("UserSetLoad", reg_user_set_load);
  xml += chunk_control() + transport_control();
  xml += "<Port Name=\"Device\" NameSpace=\"Standard\"></Port>\n</RegisterDescription>\n";
  while (xml.size() % 4 != 0) xml += '\n';  // memory is read by the word
  return xml;
}

}  // namespace lightrig::sim
