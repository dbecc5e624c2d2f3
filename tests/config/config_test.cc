#include "config/config.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <thread>

#include "config/yaml_options.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

const std::string kFolder = std::string(LAMINA_SOURCE_DIR) + "/config/";

std::vector<std::string> Lines(const std::string& path) {
  std::ifstream file(path);
  std::vector<std::string> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(line);
  return lines;
}

// The dotted name of the option that each line of a YAML file gives a value; "" for other lines.
std::vector<std::string> OptionOfLines(const std::vector<std::string>& lines) {
  std::vector<std::string> names;
  std::vector<std::string> groups;
  for (const std::string& line : lines) {
    names.emplace_back();
    const std::size_t indent = line.find_first_not_of(' ');
    if (indent == std::string::npos || line[indent] == '#') continue;
    const std::size_t colon = line.find(':');
    groups.resize(indent / 2);
    const std::string key = line.substr(indent, colon - indent);
    if (colon + 1 == line.size()) {
      groups.push_back(key);
      continue;
    }
    for (const std::string& group : groups) names.back() += group + ".";
    names.back() += key;
  }
  return names;
}

class Config : public FilesTest {
 protected:
  // What loading a file of this text, or these pairs, complains of; empty if it does not.
  std::string Complaint(const std::string& text, const std::vector<std::string>& pairs = {}) const {
    try {
      LoadConfig(Write("bad.yaml", text), pairs);
    } catch (const OptionError& error) {
      return error.what();
    }
    return "";
  }
};

TEST_F(Config, EveryShippedFileLoads) {
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(kFolder)) {
    if (entry.path().extension() != ".yaml") continue;
    ++files;
    EXPECT_NO_THROW(LoadConfig(entry.path().string(), {})) << entry.path();
  }
  EXPECT_GE(files, 4);
}

TEST_F(Config, DefaultFileHoldsTheDefaultsOfTheCode) {
  EXPECT_EQ(ToYaml(LoadConfig(kFolder + "default.yaml", {})), ToYaml(LaminaConfig()));
}

TEST_F(Config, DefaultFileListsEveryOptionInOrderWithAComment) {
  const std::vector<std::string> lines = Lines(kFolder + "default.yaml");
  const std::vector<std::string> names = OptionOfLines(lines);
  std::vector<std::string> listed;
  for (std::size_t i = 0; i < lines.size(); ++i) {
    if (names[i].empty()) continue;
    listed.push_back(names[i]);
    ASSERT_GT(i, 0U);
    const std::size_t start = lines[i - 1].find_first_not_of(' ');
    EXPECT_TRUE(start != std::string::npos && lines[i - 1][start] == '#')
        << names[i] << " has no comment above it";
  }
  LaminaConfig config;
  EXPECT_EQ(listed, OptionNames([&](OptionVisitor& v) { config.Visit(v); }));
}

TEST_F(Config, MisspeltKeyIsRefusedWithPlaceAndSuggestion) {
  const std::string complaint = Complaint("map:\n  depth: 2\n  root_sise_m: 2.0\n");
  EXPECT_THAT(complaint, HasSubstr(Path("bad.yaml") + ":3"));
  EXPECT_THAT(complaint, HasSubstr("root_sise_m"));
  EXPECT_THAT(complaint, HasSubstr("'map.root_size_m'"));
  EXPECT_THAT(Complaint("", {"backend.window.frame=3"}), HasSubstr("'backend.window.frames'"));
  // An option at the wrong level is unknown, too.
  EXPECT_THAT(Complaint("root_size_m: 2.0\n"),
              HasSubstr("unknown option 'root_size_m'; did you mean 'map.root_size_m'?"));
}

TEST_F(Config, OptionsThatContradictOneAnotherAreBothNamed) {
  const std::string complaint = Complaint("backend:\n  hand_over_lag_frames: 20\n");
  EXPECT_THAT(complaint, HasSubstr("backend.hand_over_lag_frames = 20"));
  EXPECT_THAT(complaint, HasSubstr("backend.window.frames = 15"));
  // Together they are checked when all are known.
  EXPECT_NO_THROW(LoadConfig("", {"backend.hand_over_lag_frames=20", "backend.window.frames=30"}));
}

TEST_F(Config, PosesOfSensorsAreListsOrMatricesByFolder) {
  const std::string list = "scans:\n  T_vehicle_lidar:\n    front: [1, 2, 3, 0, 0, 0.6, 0.8]\n";
  const std::string matrix =
      "    \"a b/rear.1\": [[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]]\n";
  const LaminaConfig config =
      LoadConfig(Write("a.yaml", list + matrix), {"scans.T_vehicle_lidar.top=[0,0,2, 0,0,0,1]"});
  const auto& poses = config.scans.T_vehicle_lidar;
  ASSERT_EQ(poses.size(), 3U);
  EXPECT_EQ(poses.at("front").t, Eigen::Vector3d(1, 2, 3));
  EXPECT_NEAR(poses.at("front").q.w(), 0.8, 1e-12);
  EXPECT_NEAR((poses.at("a b/rear.1") * Eigen::Vector3d(1, 0, 0) - Eigen::Vector3d(4, 6, 6)).norm(),
              0.0, 1e-12);
  EXPECT_EQ(poses.at("top").t.z(), 2.0);
  const std::string written = ToYaml(config);
  EXPECT_EQ(ToYaml(LoadConfig(Write("again.yaml", written), {})), written);
}

TEST_F(Config, PosesOfSensorsThatAreNoneAreRefusedWithValueAndRule) {
  const auto complaint = [&](const std::string& pose) {
    return Complaint("", {"scans.T_vehicle_lidar.front=" + pose});
  };
  EXPECT_THAT(complaint("[1, 2, 3]"),
              testing::AllOf(HasSubstr("scans.T_vehicle_lidar.front = [1, 2, 3]"),
                             HasSubstr("7 numbers"), HasSubstr("not 3")));
  EXPECT_THAT(complaint("[0, 0, 0, 0, 0, 0, 2]"), HasSubstr("must have length 1, not 2"));
  EXPECT_THAT(complaint("[500, 0, 0, 0, 0, 0, 1]"),
              testing::AllOf(HasSubstr("front x = 500"), HasSubstr("[-100, 100]")));
  EXPECT_THAT(complaint("[.nan, 0, 0, 0, 0, 0, 1]"), HasSubstr("front x = nan"));
  EXPECT_THAT(complaint("[2, 0, 0, 0,  0, 1, 0, 0,  0, 0, 1, 0]"), HasSubstr("must be a rotation"));
  EXPECT_THAT(complaint("[1, 0, 0, 0,  0, 1, 0, 0,  0, 0, -1, 0]"), HasSubstr("determinant is -1"));
  EXPECT_THAT(complaint("[a, b]"), HasSubstr("must be a list of numbers"));
  EXPECT_THAT(complaint("{x: 1}"), HasSubstr("must be a list of numbers"));
  EXPECT_THAT(Complaint("", {"scans.T_vehicle_lidar./front=[0, 0, 0, 0, 0, 0, 1]"}),
              HasSubstr("'/front' must be the name of a folder"));
  EXPECT_THAT(Complaint("scans:\n  T_vehicle_lidar: [0, 0, 0, 0, 0, 0, 1]\n"),
              HasSubstr("must be a single value or a group"));
  EXPECT_THAT(Complaint("scans:\n  T_vehicle_lidar: 3\n"), HasSubstr("a pose for each folder"));
}

TEST_F(Config, BeamsAreRowsOfNumbers) {
  const LaminaConfig config = LoadConfig(
      Write("a.yaml", "preparation:\n  beams:\n    - [-15, 0.25, 0.03]\n    - [1, 0, -0.01]\n"),
      {});
  ASSERT_EQ(config.preparation.beams.size(), 2U);
  EXPECT_EQ(config.preparation.beams[0].elevation_correction_deg, 0.25);
  EXPECT_EQ(config.preparation.beams[1].range_correction_m, -0.01);
  const std::string written = ToYaml(config);
  EXPECT_EQ(ToYaml(LoadConfig(Write("again.yaml", written), {})), written);
  EXPECT_TRUE(
      LoadConfig(Write("b.yaml", written), {"preparation.beams=[]"}).preparation.beams.empty());
  const auto complaint = [&](const std::string& rows) {
    return Complaint("", {"preparation.beams=" + rows});
  };
  EXPECT_THAT(complaint("[[1, 2]]"), HasSubstr("beams, row 1: must be 3 numbers, not 2"));
  EXPECT_THAT(
      complaint("[[1, 0, 0], [2, 9, 0]]"),
      testing::AllOf(HasSubstr("row 2, elevation_correction_deg = 9"), HasSubstr("[-5, 5]")));
  EXPECT_THAT(complaint("[[1, 0, .nan]]"), HasSubstr("range_correction_m = nan"));
  EXPECT_THAT(complaint("[1, 2, 3]"), HasSubstr("must be a list of rows"));
  EXPECT_THAT(complaint("3"), HasSubstr("must be a list of rows"));
}

TEST_F(Config, WrongTypesAreRefused) {
  EXPECT_THAT(Complaint("map:\n  root_size_m: big\n"),
              testing::AllOf(HasSubstr(":2:"), HasSubstr("map.root_size_m = big"),
                             HasSubstr("must be a number")));
  EXPECT_THAT(Complaint("map:\n  depth: 1.5\n"), HasSubstr("must be a whole number"));
  // YAML takes it for octal.
  EXPECT_THAT(Complaint("map:\n  depth: 03\n"), HasSubstr("without leading zeros"));
  EXPECT_EQ(Complaint("map:\n  depth: 0\n"), "");
  EXPECT_THAT(Complaint("backend:\n  enabled: maybe\n"), HasSubstr("must be true or false"));
  EXPECT_THAT(Complaint("preparation:\n  deskew: never\n"),
              testing::AllOf(HasSubstr("preparation.deskew = never"), HasSubstr("azimuth")));
  EXPECT_THAT(Complaint("map:\n  depth: [1, 2]\n"), HasSubstr("single value"));
  EXPECT_THAT(Complaint("map: 3\n"), HasSubstr("unknown option 'map'"));
  EXPECT_THAT(Complaint("- 3\n"), HasSubstr("must be a map"));
  EXPECT_THAT(Complaint("map: {depth: 1\n"), HasSubstr("not valid YAML"));
  EXPECT_THAT(Complaint("map:\n  depth: 1\n---\nmap:\n  depht: 2\n"),
              testing::AllOf(HasSubstr("bad.yaml:4"), HasSubstr("another document")));
  EXPECT_EQ(Complaint("---\nmap:\n  depth: 1\n---\n"), "");
}

TEST_F(Config, OutOfRangeNamesValueRuleAndPlace) {
  EXPECT_THAT(Complaint("map:\n  depth: 9\n"),
              testing::AllOf(StartsWith(Path("bad.yaml") + ":2"), HasSubstr("map.depth = 9"),
                             HasSubstr("[0, 4]")));
  EXPECT_THAT(Complaint("map:\n  budget_mb: .nan\n"), HasSubstr("map.budget_mb"));
  EXPECT_THAT(Complaint("", {"map.depth=-1"}),
              testing::AllOf(StartsWith("--set map.depth=-1"), HasSubstr("[0, 4]")));
}

TEST_F(Config, OptionsThatContradictOneAnotherAreNamedTogether) {
  EXPECT_THAT(
      Complaint("preparation:\n  min_range_m: 30\n  max_range_m: 30\n"),
      testing::AllOf(HasSubstr("preparation.min_range_m = 30"), HasSubstr("max_range_m = 30")));
}

TEST_F(Config, AnOptionGivenTwiceIsRefused) {
  EXPECT_THAT(Complaint("map:\n  depth: 1\n  depth: 2\n"), HasSubstr("twice"));
}

TEST_F(Config, PairsOverrideTheFileAndTheFileTheDefaults) {
  const std::string path = Write("a.yaml", "map:\n  depth: 3\n  root_size_m: 3.5\n");
  const LaminaConfig config = LoadConfig(path, {"map.depth=2", "preparation.deskew=time"});
  EXPECT_EQ(config.map.depth, 2);
  EXPECT_EQ(config.map.root_size_m, 3.5);
  EXPECT_EQ(config.preparation.deskew, ScanPreparationOptions::Deskew::kTime);
  EXPECT_EQ(config.map.min_points, VoxelMapOptions().min_points);
  EXPECT_THROW(LoadConfig(path, {"map.depth"}), OptionError);
  EXPECT_THROW(LoadConfig(path, {"=3"}), OptionError);
}

TEST_F(Config, EmptyFileIsTheDefaultsAndAMissingOneIsAnInputError) {
  EXPECT_EQ(ToYaml(LoadConfig(Write("empty.yaml", "# nothing\n"), {})), ToYaml(LaminaConfig()));
  EXPECT_THROW(LoadConfig(Path("missing.yaml"), {}), InputError);
}

TEST_F(Config, MayComeOutOfAPipeButNotOfAFolder) {
  ASSERT_EQ(mkfifo(Path("pipe").c_str(), 0600), 0);
  std::thread writer([&] { std::ofstream(Path("pipe")) << "map:\n  depth: 1\n"; });
  EXPECT_EQ(LoadConfig(Path("pipe"), {}).map.depth, 1);
  writer.join();
  EXPECT_THAT(MessageOf<InputError>([&] { LoadConfig(Path(""), {}); }),
              HasSubstr("cannot be read: Is a directory"));
}

TEST_F(Config, YamlRoundTripsEveryValue) {
  LaminaConfig config;
  config.scans.frame_period_s = 0.1 + 1e-13;
  config.preparation.rotation = ScanPreparationOptions::Rotation::kCounterclockwise;
  config.map.root_size_m = 1.0 / 3.0;
  config.map.max_fixed_weight = 1e9;
  config.frontend.search.enabled = false;
  config.backend.window.frames = 33;
  config.pipeline.min_points = 7;
  const LaminaConfig again = LoadConfig(Write("again.yaml", ToYaml(config)), {});
  EXPECT_EQ(ToYaml(again), ToYaml(config));
  EXPECT_EQ(again.map.root_size_m, 1.0 / 3.0);
  EXPECT_EQ(again.backend.window.frames, 33);
  EXPECT_FALSE(again.frontend.search.enabled);
}

TEST_F(Config, MappingOptionsAreThoseOfTheGroups) {
  const MappingOptions options =
      LoadConfig("", {"map.depth=4", "frontend.deskew_passes=3", "backend.window.frames=7",
                      "preparation.max_range_m=50", "pipeline.lookahead_scans=9"})
          .Mapping();
  EXPECT_EQ(options.mapper.map.depth, 4);
  EXPECT_EQ(options.mapper.frontend.deskew_passes, 3);
  EXPECT_EQ(options.mapper.backend.window.frames, 7);
  EXPECT_EQ(options.preparation.max_range_m, 50.0);
  EXPECT_EQ(options.pipeline.lookahead_scans, 9);
}

}  // namespace
}  // namespace lamina
