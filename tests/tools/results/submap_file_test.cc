#include "tools/results/submap_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "io/file/section_file.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

Submap RandomSubmap(std::int64_t id, Draws* draws) {
  Submap submap;
  submap.id = id;
  submap.leaf_size_m = 0.8;
  submap.T_world_submap = draws->Pose(10.0);
  submap.way_m = draws->Uniform(0, 30);
  for (int i = 0; i < 3; ++i) submap.keyframes.push_back({i, 100 * i, draws->Pose(3.0)});
  for (std::int16_t i = 0; i < 20; ++i) {
    SubmapLeaf leaf;
    leaf.index[0] = i;
    leaf.keyframes = 2;
    leaf.cluster.count = 7.5F;
    for (float& x : leaf.cluster.mean) x = static_cast<float>(draws->Uniform(-0.4, 0.4));
    for (float& x : leaf.cluster.covariance) x = static_cast<float>(draws->Uniform(0.0, 0.1));
    submap.leaves.push_back(leaf);
  }
  return submap;
}

class SubmapFileTest : public FilesTest {
 protected:
  SubmapFileTest() {
    Draws draws(4);
    for (int i = 0; i < 3; ++i) submaps_.push_back(RandomSubmap(i == 2 ? 0 : i, &draws));
    view_.frame = 1;
    view_.pieces = {1, 1, 4};
    for (const Submap& submap : submaps_) view_.submaps.push_back(&submap);
    for (int i = 0; i < 3; ++i) view_.graph.poses.push_back(draws.Pose(20.0));
    view_.graph.odometry = {{0, 1, draws.Pose(5.0), 3.0 * Matrix6d::Identity()}};
    view_.graph.loops = {{0, 2, draws.Pose(5.0), 2.0 * Matrix6d::Identity()}};
    view_.trimmed[1] = {{1, 50, draws.Pose(5.0), draws.Pose(5.0)},
                        {0, 60, draws.Pose(5.0), draws.Pose(5.0)}};
  }
  std::string Written() const {
    WriteSubmaps(Path("a.bin"), {view_});
    return Bytes(Path("a.bin"));
  }
  // The message of the error that reading such a file ends with.
  std::string Refusal() const {
    WriteSubmaps(Path("b.bin"), {view_});
    return MessageOf<InputError>([&] { ReadSubmaps(Path("b.bin")); });
  }

  std::vector<Submap> submaps_;
  SubmapFrameView view_;
};

TEST_F(SubmapFileTest, IsReadBackToTheLastBit) {
  const std::string bytes = Written();
  const std::vector<SubmapFrame> frames = ReadSubmaps(Path("a.bin"));
  ASSERT_EQ(frames.size(), 1U);
  const SubmapFrame& frame = frames[0];
  EXPECT_EQ(frame.frame, 1);
  EXPECT_EQ(frame.pieces, view_.pieces);
  ASSERT_EQ(frame.submaps.size(), submaps_.size());
  for (std::size_t i = 0; i < submaps_.size(); ++i) {
    const Submap &a = submaps_[i], &b = frame.submaps[i];
    EXPECT_EQ(b.T_world_submap.q.coeffs(), a.T_world_submap.q.coeffs());
    EXPECT_EQ(b.keyframes.size(), a.keyframes.size());
    ASSERT_EQ(b.leaves.size(), a.leaves.size());
    EXPECT_EQ(std::memcmp(b.leaves.data(), a.leaves.data(), 48 * a.leaves.size()), 0);
    EXPECT_EQ(frame.graph.poses[i].t, view_.graph.poses[i].t);
  }
  EXPECT_EQ(frame.graph.odometry[0].T_from_to.t, view_.graph.odometry[0].T_from_to.t);
  EXPECT_EQ(frame.graph.loops[0].to, 2U);
  ASSERT_EQ(frame.trimmed.at(1).size(), 2U);
  EXPECT_EQ(frame.trimmed.at(1)[0].holder, 1U);
  EXPECT_EQ(frame.trimmed.at(1)[1].T_holder_submap.t, view_.trimmed.at(1)[1].T_holder_submap.t);
  SubmapFrameView again{frame.frame, frame.pieces, {}, frame.graph, frame.trimmed};
  for (const Submap& submap : frame.submaps) again.submaps.push_back(&submap);
  WriteSubmaps(Path("again.bin"), {again});
  EXPECT_EQ(Bytes(Path("again.bin")), bytes);
}

TEST_F(SubmapFileTest, OfTrimmedSubmapsIdsHaveGapsAndHoldersAreThere) {
  submaps_[1].id = 7;
  EXPECT_NO_THROW({
    Written();
    EXPECT_EQ(ReadSubmaps(Path("a.bin"))[0].submaps[1].id, 7);
  });
  view_.trimmed[1][1].holder = 3;
  EXPECT_THAT(Refusal(), HasSubstr("trimmed submap 1"));
  view_.trimmed[1][1].holder = 0;
  std::swap(view_.trimmed[1][0], view_.trimmed[1][1]);
  EXPECT_THAT(Refusal(), HasSubstr("trimmed submap 1"));
  view_.trimmed = {{1, {{2, 50, SE3(), SE3()}}}};
  EXPECT_THAT(Refusal(), HasSubstr("piece 1 has no holder"));
  // A file without any has no section of them.
  view_.trimmed.clear();
  EXPECT_EQ(Written().find("TRIM"), std::string::npos);
}

TEST_F(SubmapFileTest, DamageIsAnErrorThatNamesTheFile) {
  const std::string bytes = Written();
  for (std::size_t i = 0; i < bytes.size(); i += 37) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x20);
    Write("a.bin", damaged);
    EXPECT_THAT(MessageOf<InputError>([&] { ReadSubmaps(Path("a.bin")); }),
                testing::HasSubstr("a.bin"));
  }
  for (std::size_t size = 0; size < bytes.size(); size += 101) {
    Write("a.bin", bytes.substr(0, size));
    EXPECT_THROW(ReadSubmaps(Path("a.bin")), InputError) << size;
  }
}

TEST_F(SubmapFileTest, SectionsThatAreTooShortOrUnknownAreRefused) {
  constexpr SectionFileKind kKind = {"LAMINASM", 1, "a file of submaps"};
  for (const auto& [tag, bytes] : std::vector<std::pair<std::string, std::string>>{
           {"FRAM", "short"}, {"SUBM", std::string(100, '\0')}, {"WHAT", ""}}) {
    SectionWriter writer(Path("a.bin"), kKind);
    writer.Write(tag, bytes);
    writer.Commit();
    EXPECT_THAT(MessageOf<InputError>([&] { ReadSubmaps(Path("a.bin")); }),
                testing::HasSubstr("a.bin"))
        << tag;
  }
}

TEST_F(SubmapFileTest, WhatCannotBeIsRefused) {
  submaps_[1].leaves[3].cluster.mean[1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THAT(Refusal(), testing::HasSubstr("submap 1 of piece 1: leaf 3 is no cluster"));
  submaps_[1].leaves[3].cluster.mean[1] = 0.0F;
  std::swap(submaps_[1].leaves[3], submaps_[1].leaves[4]);
  EXPECT_THAT(Refusal(), testing::HasSubstr("out of order"));
  std::swap(submaps_[1].leaves[3], submaps_[1].leaves[4]);
  submaps_[1].keyframes.clear();
  EXPECT_THAT(Refusal(), testing::HasSubstr("no keyframe"));
  submaps_[1].keyframes = submaps_[0].keyframes;
  view_.graph.loops[0].to = 7;
  EXPECT_THAT(Refusal(), testing::HasSubstr("edge is of a submap that there is not"));
  view_.graph.loops[0].to = 2;
  view_.graph.poses.pop_back();
  view_.graph.loops.clear();
  EXPECT_THAT(Refusal(), testing::HasSubstr("3 submaps and 2 anchors"));
}

}  // namespace
}  // namespace lamina
