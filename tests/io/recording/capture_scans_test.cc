// Sweeps of sensors whose packets were captured.
#include <cstdlib>

#include "io/recording/scan_source.h"
#include "tests/support/container_files.h"
#include "tests/support/velodyne_files.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

constexpr StampNs kFirst = 1700000000000000000, kApart = 1'327'104;
constexpr std::size_t kPoints = 12 * 32;

class CaptureScansTest : public FilesTest {
 protected:
  // A quarter turn a packet, from 45 deg on: sweeps of 3, 4, 4, ... packets.
  static std::string Packet(std::size_t i) {
    return RoundPacket(static_cast<std::uint16_t>((4500 + 9000 * i) % 36000),
                       static_cast<std::uint32_t>(i * kApart / 1000));
  }
  static StampNs StampOf(std::size_t i) { return kFirst + static_cast<StampNs>(i) * kApart; }
  static std::string Pcap(std::size_t packets, bool nanoseconds = true, bool vlan = false) {
    std::string bytes = PcapHead(nanoseconds);
    for (std::size_t i = 0; i < packets; ++i) {
      bytes += PcapPacket(StampOf(i), UdpFrame(Packet(i), 7, vlan), nanoseconds);
    }
    return bytes;
  }
  void ExpectSweeps(const std::string& path, double tolerance_ns) const {
    const auto scans = OpenScans(path, {});
    ASSERT_EQ(scans->size(), 3U);
    std::size_t first = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      const Scan scan = scans->Read(i);
      EXPECT_NEAR(static_cast<double>(scan.stamp_ns - StampOf(first)), 0.0, tolerance_ns);
      EXPECT_EQ(scan.stamp_ns, scans->Stamp(i));
      EXPECT_THAT(scan.points, SizeIs(kPoints * 4));
      EXPECT_NEAR(scan.time_s[kPoints], 1e-9 * kApart, 2e-6);
      first += 4;
    }
    EXPECT_THAT(scans->Describe().scans,
                AllOf(HasSubstr("3 sweeps of 12 packets of VLP-16, one return"),
                      HasSubstr("10.0.0.7:2368")));
  }
};

TEST_F(CaptureScansTest, PcapAndPcapng) {
  ExpectSweeps(Write("a.pcap", Pcap(12)), 0.0);
  ExpectSweeps(Write("b.pcap", Pcap(12, false, true)), 1000.0);
  std::string bytes = PcapngHead();
  for (std::size_t i = 0; i < 12; ++i) {
    // Statistics, and packets that are none of a sensor's.
    bytes += PcapngBlock(5, std::string(8, '\0'));
    bytes += PcapngPacket(StampOf(i), UdpFrame("something else", 9));
    bytes += PcapngPacket(StampOf(i), UdpFrame(Packet(i), 7));
  }
  ExpectSweeps(Write("c.pcapng", bytes), 0.0);
}

TEST_F(CaptureScansTest, OneOfSeveralSensorsIsChosen) {
  std::string bytes = PcapHead(true);
  for (std::size_t i = 0; i < 8; ++i) {
    bytes += PcapPacket(StampOf(i), UdpFrame(Packet(i), 7), true);
    if (i % 2 == 0) bytes += PcapPacket(StampOf(i), UdpFrame(Packet(i), 8), true);
  }
  const std::string path = Write("a.pcap", bytes);
  ScanSourceOptions options;
  EXPECT_THAT(MessageOf<InputError>([&] { OpenScans(path, options); }),
              AllOf(HasSubstr("10.0.0.7:2368 (8 packets), 10.0.0.8:2368 (4 packets)"),
                    HasSubstr("--topic")));
  options.topic = "10.0.0.7:2368";
  EXPECT_THAT(OpenScans(path, options)->Read(1).points, SizeIs(kPoints * 4));
}

TEST_F(CaptureScansTest, OfACutFileThereIsWhatIsBeforeTheCut) {
  const std::string whole = Pcap(40);
  std::size_t before = 0;
  for (std::size_t cut = 1; cut < 100; ++cut) {
    const std::string path = Write("a.pcap", whole.substr(0, whole.size() * cut / 100));
    try {
      const auto scans = OpenScans(path, {});
      EXPECT_GE(scans->size(), before);
      before = scans->size();
      for (std::size_t i = 0; i < scans->size(); ++i) scans->Read(i);
    } catch (const InputError& error) {
      EXPECT_EQ(before, 0U) << error.what();
    }
  }
  EXPECT_EQ(before, 10U);
  EXPECT_THAT(OpenScans(Path("a.pcap"), {})->Describe().doubts,
              ElementsAre(HasSubstr("read as far as it goes")));
}

TEST_F(CaptureScansTest, FlippedBitsGiveErrorsAndNoCrash) {
  std::string pcapng = PcapngHead();
  for (std::size_t i = 0; i < 6; ++i) {
    pcapng += PcapngPacket(StampOf(i), UdpFrame(Packet(i), 7));
  }
  std::uint32_t random = 7;
  for (const std::string& bytes : {Pcap(6), pcapng}) {
    for (int trial = 0; trial < 500; ++trial) {
      random = random * 1664525 + 1013904223;
      std::string damaged = bytes;
      // Mostly in the heads.
      const std::size_t at = (random >> 8) % (trial % 4 == 0 ? bytes.size() : 200);
      damaged[at] = static_cast<char>(damaged[at] ^ (1 << (random >> 29)));
      try {
        const auto scans = OpenScans(Write("a.pcap", damaged), {});
        for (std::size_t i = 0; i < scans->size(); ++i) scans->Read(i);
      } catch (const InputError&) {
      }
    }
  }
}

// Captures of real sensors, with the counts that other programs found in them.
TEST_F(CaptureScansTest, RealSensors) {
  const char* recordings = std::getenv("LAMINA_RECORDINGS");
  const std::string folder = std::string(recordings == nullptr ? "" : recordings) + "/formats/";
  if (!std::filesystem::exists(folder + "velodyne_pcap")) {
    GTEST_SKIP() << "LAMINA_RECORDINGS names no folder with formats/velodyne_pcap";
  }
  const auto points = [](const ScanSource& scans) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < scans.size(); ++i) count += scans.Read(i).points.size();
    return count;
  };
  const auto hdl = OpenScans(folder + "velodyne_pcap/sample_velodyne_hdl32.pcap", {});
  EXPECT_EQ(hdl->size(), 4U);
  EXPECT_EQ(points(*hdl), 146705U);
  EXPECT_THAT(hdl->Describe().scans, HasSubstr("HDL-32E, one return"));
  const auto puck = OpenScans(folder + "velodyne_pcap/sample_velodyne_vlp16_gps.pcap", {});
  EXPECT_EQ(puck->size(), 5U);
  EXPECT_EQ(points(*puck), 73486U);
  // Messages of packets, both returns.
  const auto bag = OpenScans(folder + "velodyne_ros2_vlp16/1673400471837873222", {});
  EXPECT_EQ(bag->size(), 4U);
  EXPECT_EQ(bag->Stamp(0), 1673400471737763166);
  EXPECT_THAT(bag->PointTimes(0).name, "packets");
  EXPECT_NEAR(static_cast<double>(points(*bag)) / 4.0, 14850.0, 50.0);
}

}  // namespace
}  // namespace lamina
