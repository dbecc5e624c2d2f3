#include "io/recording/vehicle_scans.h"

#include "io/inbox/streamed_scans.h"
#include "tests/support/files/inbox_scenes.h"

namespace lamina {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

const SE3 kFront(Eigen::Quaterniond::Identity(), {2, 0, 0});
const SE3 kRear(ExpSO3({0, 0, M_PI}), {-1, 0, 0});

TEST(FindMount, FoldersAreNamedByTheLastPartsOfTheirPath) {
  const std::map<std::string, SE3> mounts = {{"front", kFront}, {"drive1/front", kRear}};
  EXPECT_FALSE(FindMount(mounts, ""));
  EXPECT_FALSE(FindMount(mounts, "upfront"));
  EXPECT_FALSE(FindMount(mounts, "front/left"));
  EXPECT_EQ(FindMount(mounts, "front")->vehicle, "/");
  EXPECT_EQ(FindMount(mounts, "drive2/front")->vehicle, "drive2/");
  EXPECT_EQ(FindMount(mounts, "drive2/front")->T_vehicle_lidar.t.x(), 2.0);
  EXPECT_EQ(FindMount(mounts, "drive1/front")->T_vehicle_lidar.t.x(), -1.0);
}

class VehicleScansTest : public FilesTest {
 protected:
  VehicleScansTest() { options_.T_vehicle_lidar = {{"front", kFront}, {"rear", kRear}}; }
  // Scans whose names are stamps in ns.
  void Drop(const std::string& folder, const std::vector<int>& ms) const {
    for (const int t : ms) {
      Write(folder + "/" + std::to_string(1'600'000'000'000 + t) + "000000.bin",
            KittiBin({{1, 0, 0, 0}}));
    }
  }
  ScanSourceOptions options_;
};

TEST_F(VehicleScansTest, ScansOfAllSensorsComeInTheOrderOfTheirStamps) {
  Drop("front", {0, 100, 200});
  Drop("rear", {50, 160, 260, 350});
  const auto scans = OpenScans(folder_.string(), options_);
  ASSERT_EQ(scans->size(), 7U);
  std::vector<std::string> sensors;
  for (std::size_t i = 0; i < scans->size(); ++i) {
    sensors.push_back(scans->Sensor(i));
    EXPECT_EQ(scans->Recording(i), scans->Recording(0));
    EXPECT_EQ(scans->T_vehicle_lidar(i).t.x(), scans->Sensor(i) == "front" ? 2.0 : -1.0);
    EXPECT_EQ(scans->Read(i).stamp_ns, scans->Stamp(i));
    if (i > 0) {
      EXPECT_LT(scans->Stamp(i - 1), scans->Stamp(i));
    }
  }
  EXPECT_THAT(sensors, ElementsAre("front", "rear", "front", "rear", "front", "rear", "rear"));
  // The period of a sweep is that of one sensor.
  const StampNs t0 = scans->Stamp(0), ms = 1'000'000;
  EXPECT_THAT(scans->StampsUpTo(4, 0, 10), ElementsAre(t0, t0 + 100 * ms, t0 + 200 * ms));
  EXPECT_THAT(scans->StampsUpTo(5, 2, 10), ElementsAre(t0 + 160 * ms, t0 + 260 * ms));
  EXPECT_THAT(scans->StampsUpTo(6, 0, 2), ElementsAre(t0 + 260 * ms, t0 + 350 * ms));
  EXPECT_EQ(scans->StampAfter(0), t0 + 100 * ms);
  EXPECT_EQ(scans->StampAfter(4), std::nullopt);
}

TEST_F(VehicleScansTest, EachSensorIsDescribed) {
  Drop("front", {0, 100, 200});
  Drop("rear", {50, 160});
  RecordingDescription said = OpenScans(folder_.string(), options_)->Describe();
  EXPECT_THAT(said.scans,
              testing::AllOf(HasSubstr("front: 3 files *.bin"), HasSubstr("rear: 2 files *.bin"),
                             HasSubstr("all in the order of their stamps")));
  EXPECT_EQ(said.stamps, "from the files' names");
  EXPECT_THAT(said.doubts, IsEmpty());
  Write("front/times.txt", "1600000000.0\n1600000000.2\n1600000000.1\n");
  said = OpenScans(folder_.string(), options_)->Describe();
  EXPECT_EQ(said.stamps, "front: from times.txt; rear: from the files' names");
  EXPECT_THAT(said.doubts, ElementsAre(testing::StartsWith("front: 1 stamps are not after")));
}

TEST_F(VehicleScansTest, AFolderThatIsMissingOrHasNoStampsIsNamedWithTheOption) {
  Drop("front", {0, 100});
  const auto complaint = [&] {
    return MessageOf<InputError>([&] { OpenScans(folder_.string(), options_); });
  };
  EXPECT_THAT(complaint(),
              testing::AllOf(HasSubstr("/rear"), HasSubstr("scans.T_vehicle_lidar.rear")));
  Write("rear/a.bin", KittiBin({{1, 0, 0, 0}}));
  EXPECT_THAT(complaint(), testing::AllOf(HasSubstr("/rear: has no stamps"),
                                          HasSubstr("scans.T_vehicle_lidar")));
  // One sensor alone needs no order among several.
  options_.T_vehicle_lidar.erase("front");
  EXPECT_EQ(OpenScans(folder_.string(), options_)->size(), 1U);
}

TEST_F(VehicleScansTest, StreamedScansOfAVehicleAreOneRecording) {
  StreamedScans scans(0, options_);
  for (const std::string folder : {"front", "rear", "other"}) {
    InboxFile file;
    file.sequence = folder;
    scans.Append(file);
  }
  EXPECT_EQ(scans.Recording(0), "/");
  EXPECT_EQ(scans.Recording(1), "/");
  EXPECT_EQ(scans.Recording(2), "other");
  EXPECT_EQ(scans.Sensor(1), "rear");
  EXPECT_EQ(scans.T_vehicle_lidar(1).t.x(), -1.0);
  EXPECT_EQ(scans.T_vehicle_lidar(2).t.x(), 0.0);
}

class VehicleInboxTest : public InboxScene {
 protected:
  VehicleInboxTest() { scans_.T_vehicle_lidar = {{"front", kFront}, {"rear", kRear}}; }
  static std::string Name(const std::string& folder, int ms) {
    return folder + "/" + std::to_string(1'600'000'000'000 + ms) + "000000.bin";
  }
};

TEST_F(VehicleInboxTest, FilesThatAreThereComeInTheOrderOfTheirStamps) {
  for (const int t : {0, 100, 200}) DropOld(Name("d/front", t));
  for (const int t : {50, 160, 170}) DropOld(Name("d/rear", t));
  Open();
  inbox_->Drain();
  EXPECT_THAT(Take(), ElementsAre(Name("d/front", 0), Name("d/rear", 50), Name("d/front", 100),
                                  Name("d/rear", 160), Name("d/rear", 170), Name("d/front", 200)));
}

TEST_F(VehicleInboxTest, AFileWaitsForTheOtherSensorsButNotForEver) {
  Open();
  for (int t = 0; t < 1200; t += 100) {
    Drop(Name("front", t));
    Drop(Name("rear", t + 50));
  }
  // Files in a folder that is new were perhaps not seen being closed.
  for (int i = 0; i < 4; ++i) Pass(0.51);
  EXPECT_EQ(Take().size(), 24U);
  Drop(Name("front", 1200));
  Pass(0.05);
  EXPECT_THAT(Take(), IsEmpty()) << "one from the rear may be earlier";
  Drop(Name("rear", 1250));
  Pass(0.0);
  EXPECT_THAT(Take(), ElementsAre(Name("front", 1200)));
  Pass(0.15);
  EXPECT_THAT(Take(), IsEmpty()) << "one from the front may be earlier";
  Pass(0.1);
  EXPECT_THAT(Take(), ElementsAre(Name("rear", 1250)));
}

TEST_F(VehicleInboxTest, FilesWithoutStampsAreRefused) {
  DropOld("front/1.bin");
  DropOld(Name("rear", 50));
  Open();
  inbox_->Drain();
  EXPECT_THAT(Take(), ElementsAre(Name("rear", 50)));
  EXPECT_THAT(Refused(), ElementsAre("front/1.bin"));
}

}  // namespace
}  // namespace lamina
