// Sweeps of sensors whose packets were captured.
#include <cstdlib>
#include <fstream>

#include "io/recording/scan_source.h"
#include "tests/support/files/container_files.h"
#include "tests/support/files/ouster_files.h"
#include "tests/support/files/velodyne_files.h"
#include "tests/support/peak_memory.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

constexpr StampNs kFirstCaptured = 1700000000000000000, kApart = 1'327'104;
constexpr std::size_t kPoints = 12 * 32;

class CaptureScansTest : public FilesTest {
 protected:
  // A quarter turn a packet, from 45 deg on: sweeps of 3, 4, 4, ... packets.
  static std::string Packet(std::size_t i) {
    return RoundPacket(static_cast<std::uint16_t>((4500 + 9000 * i) % 36000),
                       static_cast<std::uint32_t>(i * kApart / 1000));
  }
  static StampNs StampOf(std::size_t i) {
    return kFirstCaptured + static_cast<StampNs>(i) * kApart;
  }
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

class OusterCaptureTest : public CaptureScansTest {
 protected:
  static constexpr int kChannels = 16;
  static constexpr const char* kProfile = "RNG19_RFL8_SIG16_NIR16";

  // Frames of 4 packets; every channel at 5 m.
  static std::string Packet(std::size_t i) {
    return OusterPacket(false, static_cast<std::uint16_t>(i / 4), static_cast<int>(i % 4) * 16,
                        kChannels, [](int, int) { return Pack(5000U, 0U, 0U); });
  }
  // The frames of the packets in turn, some of them sent twice or in another order.
  static std::string Capture(std::size_t packets) {
    std::string bytes = PcapHead(true);
    for (std::size_t i = 0; i < packets; ++i) {
      auto frames = UdpFragments(Packet(i), 7, static_cast<std::uint16_t>(i));
      if (i == 2) std::swap(frames[0], frames[1]);
      for (const std::string& frame : frames) bytes += PcapPacket(StampOf(i), frame, true);
    }
    return bytes;
  }
  std::string MessageOfOpening(const std::string& path) const {
    return MessageOf<InputError>([&] { OpenScans(path, {}); });
  }
};

TEST_F(OusterCaptureTest, FramesOutOfFragments) {
  Write("a.json", OusterMetadataText(kProfile, kChannels, true));
  const auto scans = OpenScans(Write("a.pcap", Capture(12)), {});
  ASSERT_EQ(scans->size(), 3U);
  EXPECT_THAT(scans->Describe().scans,
              AllOf(HasSubstr("3 sweeps of 12 packets of OS-1-16, RNG19_RFL8_SIG16_NIR16"),
                    HasSubstr("10.0.0.7:2368")));
  for (std::size_t i = 0; i < 3; ++i) {
    const Scan scan = scans->Read(i);
    EXPECT_THAT(scan.points, SizeIs(60 * kChannels));
    EXPECT_EQ(scan.stamp_ns, StampOf(4 * i));
    EXPECT_NEAR(scan.time_s.back(), 62e-4, 1e-7);
  }
  // A fragment that is missing costs its packet alone.
  std::string bytes = PcapHead(true);
  for (std::size_t i = 0; i < 4; ++i) {
    const auto frames = UdpFragments(Packet(i), 7, static_cast<std::uint16_t>(i));
    for (std::size_t k = i == 1 ? 1 : 0; k < frames.size(); ++k) {
      bytes += PcapPacket(StampOf(i), frames[k], true);
    }
  }
  EXPECT_THAT(OpenScans(Write("a.pcap", bytes), {})->Read(0).points, SizeIs(45 * kChannels));
}

TEST_F(OusterCaptureTest, WithoutItsMetadataAClearError) {
  const std::string path = Write("a.pcap", Capture(4));
  EXPECT_THAT(MessageOfOpening(path), AllOf(HasSubstr("Ouster"), HasSubstr("a.json")));
  Write("metadata.json", "{}");
  EXPECT_THAT(MessageOfOpening(path), AllOf(HasSubstr("metadata.json"), HasSubstr("lidar_mode")));
  Write("metadata.json", OusterMetadataText(kProfile, 32, true));
  EXPECT_THAT(MessageOfOpening(path), HasSubstr("of another sensor, or of another mode"));
  Write("metadata.json", OusterMetadataText(kProfile, kChannels, false));
  EXPECT_EQ(OpenScans(path, {})->size(), 1U);
}

TEST_F(OusterCaptureTest, HostileFragmentsTakeNoMemoryAndCrashNothing) {
  Write("a.json", OusterMetadataText(kProfile, kChannels, true));
  std::string bytes = PcapHead(true);
  // Datagrams that never end, overlap, or are longer than any.
  for (std::uint16_t i = 0; i < 500; ++i) {
    const std::string part(1480, 'x');
    bytes += PcapPacket(kFirstCaptured, IpFrame(part, 7, 0x2000, i), true);
    bytes += PcapPacket(kFirstCaptured, IpFrame(part, 7, 0x2001, static_cast<std::uint16_t>(i + 7)),
                        true);
    bytes += PcapPacket(kFirstCaptured, IpFrame(part, 7, 0x1FFF, static_cast<std::uint16_t>(i + 9)),
                        true);
    bytes += PcapPacket(kFirstCaptured, IpFrame("", 7, 0x2000, static_cast<std::uint16_t>(i + 11)),
                        true);
  }
  EXPECT_THAT(MessageOfOpening(Write("a.pcap", bytes)), HasSubstr("holds no packets"));
  const std::string sound = Capture(4);
  EXPECT_EQ(OpenScans(Write("a.pcap", bytes + sound.substr(24)), {})->size(), 1U);
}

// Captures of every kind, of six sweeps, with what must lie beside them.
class DamagedCaptureTest : public OusterCaptureTest {
 protected:
  static constexpr std::size_t kPackets = 24;
  struct Kind {
    std::string name, bytes;
    std::size_t sweeps;
  };

  DamagedCaptureTest() {
    Write("ouster.json", OusterMetadataText(kProfile, kChannels, true));
    Write("hdl.xml", Hdl64eXml());
    std::string next = PcapngHead(), hdl = PcapHead(false);
    for (std::size_t i = 0; i < kPackets; ++i) {
      std::string packet = CaptureScansTest::Packet(i);
      next += PcapngPacket(StampOf(i), UdpFrame(packet, 7));
      for (std::size_t b = 1; b < 12; b += 2) packet.replace(100 * b, 2, "\xFF\xDD");
      hdl += PcapPacket(StampOf(i), UdpFrame(packet, 7), false);
    }
    kinds_ = {{"velodyne.pcap", Pcap(kPackets), 6},
              {"velodyne.pcapng", next, 6},
              {"hdl.pcap", hdl, 6},
              {"ouster.pcap", Capture(kPackets), 6}};
  }

  // How many sweeps can be read of a file, and none where it cannot be opened.
  std::size_t ReadAll(const std::string& name, const std::string& bytes) const {
    std::size_t read = 0;
    try {
      const auto scans = OpenScans(WriteAnew(name, bytes), {});
      for (std::size_t i = 0; i < scans->size(); ++i) {
        try {
          scans->Read(i);
          ++read;
        } catch (const InputError& error) {
          EXPECT_THAT(error.what(), HasSubstr(name));
        }
      }
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(name));
    }
    return read;
  }

  std::vector<Kind> kinds_;
};

TEST_F(DamagedCaptureTest, OfACutFileThereIsWhatIsBeforeTheCut) {
  const ExpectBoundedMemory bounded;
  for (const Kind& kind : kinds_) {
    SCOPED_TRACE(kind.name);
    ASSERT_EQ(ReadAll(kind.name, kind.bytes), kind.sweeps);
    std::size_t before = 0;
    for (std::size_t cut = 1; cut <= 100; ++cut) {
      const std::string part = kind.bytes.substr(0, kind.bytes.size() * cut / 101);
      const std::size_t read = ReadAll(kind.name, part);
      EXPECT_GE(read, before) << cut;
      before = read;
    }
    EXPECT_EQ(before, kind.sweeps);
    EXPECT_THAT(OpenScans(Path(kind.name), {})->Describe().doubts,
                ElementsAre(HasSubstr("read as far as it goes")));
  }
}

TEST_F(DamagedCaptureTest, FlippedBitsGiveErrorsAndNoCrash) {
  const ExpectBoundedMemory bounded;
  std::uint32_t random = 7;
  for (const Kind& kind : kinds_) {
    for (int trial = 0; trial < 400; ++trial) {
      random = random * 1664525 + 1013904223;
      std::string damaged = kind.bytes;
      // Mostly in the heads: of the file, of packets, of what is in them.
      const std::size_t at = (random >> 8) % (trial % 4 == 0 ? damaged.size() : 200);
      damaged[at] = static_cast<char>(damaged[at] ^ (1 << (random >> 29)));
      EXPECT_LE(ReadAll(kind.name, damaged), kPackets) << kind.name << " " << trial;
    }
  }
}

// A frame that never ends: packets of one number, again and again.
TEST_F(DamagedCaptureTest, ASweepOfMorePointsThanASensorMeasuresIsRefused) {
  Write("bomb.json", OusterMetadataText(kProfile, 128, true));
  const std::string packet =
      OusterPacket(false, 5, 0, 128, [](int, int) { return Pack(5000U, 0U, 0U); });
  {
    std::ofstream file(Path("bomb.pcap"), std::ios::binary);
    file << PcapHead(true);
    for (std::uint16_t i = 0; i < 1200; ++i) {
      for (const std::string& frame : UdpFragments(packet, 7, i)) {
        file << PcapPacket(StampOf(i), frame, true);
      }
    }
  }
  const ExpectBoundedMemory bounded;
  const auto scans = OpenScans(Path("bomb.pcap"), {});
  EXPECT_THAT(MessageOf<InputError>([&] { scans->Read(0); }),
              HasSubstr("bomb.pcap#0: more than 2000000 points"));
}

TEST_F(CaptureScansTest, AnHdl64eNeedsItsCalibration) {
  std::string bytes = PcapHead(true);
  for (std::size_t i = 0; i < 4; ++i) {
    std::string packet = Packet(i);
    for (std::size_t b = 1; b < 12; b += 2) packet.replace(100 * b, 2, "\xFF\xDD");
    bytes += PcapPacket(StampOf(i), UdpFrame(packet, 7), true);
  }
  const std::string path = Write("a.pcap", bytes);
  EXPECT_THAT(MessageOf<InputError>([&] { OpenScans(path, {}); }),
              AllOf(HasSubstr("HDL-64E"), HasSubstr("db.xml")));
  Write("db.xml", Hdl64eXml());
  const auto scans = OpenScans(path, {});
  EXPECT_THAT(scans->Describe().scans, HasSubstr("of HDL-64E"));
  EXPECT_THAT(scans->Read(0).points, SizeIs(kPoints * 4));
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
  // Of Ouster: first returns, and at most so many second ones.
  const struct {
    const char* name;
    std::size_t first, second;
  } ouster[] = {{"OS-2-32-U0_v2.0.0_1024x10", 28541, 0},
                {"OS-2-128-U1_v2.3.0_1024x10", 119682, 0},
                {"OS-0-32-U1_v2.2.0_1024x10", 21631, 172},
                {"OS-1-128_767798045_1024x10_20230712_120049", 16373, 1089},
                {"windowed_frame1", 9246, 0}};
  for (const auto& sample : ouster) {
    const auto scans = OpenScans(folder + "ouster/" + sample.name + ".pcap", {});
    EXPECT_EQ(scans->size(), 1U) << sample.name;
    EXPECT_GE(points(*scans), sample.first) << sample.name;
    EXPECT_LE(points(*scans), sample.first + sample.second) << sample.name;
  }
  // Messages of packets, both returns.
  const auto bag = OpenScans(folder + "velodyne_ros2_vlp16/1673400471837873222", {});
  EXPECT_EQ(bag->size(), 4U);
  EXPECT_EQ(bag->Stamp(0), 1673400471737763166);
  EXPECT_THAT(bag->PointTimes(0).name, "packets");
  EXPECT_NEAR(static_cast<double>(points(*bag)) / 4.0, 14850.0, 50.0);
}

}  // namespace
}  // namespace lamina
