// A scan out of a message: any layout of points, both byte orders, every way to tell their times.
#include "io/message/lidar_message.h"

#include <cmath>
#include <limits>

#include "tests/support/files/container_files.h"

namespace lamina {
namespace {

using Form = WireWriter::Form;
using testing::ElementsAre;
using testing::FloatNear;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pointwise;
using testing::SizeIs;

constexpr StampNs kStamp = 1700000000123456789;
const float kNan = std::numeric_limits<float>::quiet_NaN();

MessageTopic Topic(const std::string& type, Form form) {
  MessageTopic topic;
  topic.name = "/t";
  topic.type = type;
  topic.encoding = form == Form::kRos1 ? MessageEncoding::kRos1 : MessageEncoding::kCdr;
  return topic;
}

Scan ReadCloud(Form form, const std::string& bytes, LidarMessageInfo* info = nullptr,
               PointTimeUnit unit = PointTimeUnit::kAuto) {
  return ScanFromMessage(Topic("sensor_msgs/PointCloud2", form), bytes, unit, "a.bag#3", info);
}

std::vector<float> Xs(const Scan& scan) {
  std::vector<float> xs;
  for (const ScanPoint& p : scan.points) xs.push_back(p.x);
  return xs;
}

TEST(LidarMessage, AnyLayoutAndByteOrder) {
  // Rows of two points of 40 bytes, and 6 bytes behind each row; nothing in the usual place.
  const std::vector<WrittenField> fields = {{"ring", 1, 4}, {"z", 20, 8},         {"y", 9, 7},
                                            {"x", 28, 8},   {"intensity", 13, 2}, {"T", 36, 6}};
  for (const Form form : {Form::kRos1, Form::kCdr, Form::kCdrBigEndian}) {
    for (const bool big : {false, true}) {
      std::string data;
      for (int i = 0; i < 4; ++i) {
        std::string point(40, '\xA5');
        const auto put = [&](std::size_t at, std::string bytes) {
          if (big) bytes = {bytes.rbegin(), bytes.rend()};
          point.replace(at, bytes.size(), bytes);
        };
        put(28, Pack(1.5 + i));
        put(9, Pack(2.5F));
        put(20, Pack(-3.5));
        put(13, Pack(static_cast<std::uint8_t>(200 + i)));
        put(36, Pack(static_cast<std::uint32_t>(i * 30'000'000)));
        data += point;
        if (i % 2 == 1) data += std::string(6, '\xA5');
      }
      LidarMessageInfo info;
      const std::string bytes = CloudMessage(form, kStamp, fields, 2, 2, 40, 86, data, big);
      const Scan scan = ReadCloud(form, bytes, &info);
      EXPECT_THAT(Xs(scan), ElementsAre(1.5F, 2.5F, 3.5F, 4.5F));
      EXPECT_EQ(scan.points[3].y, 2.5F);
      EXPECT_EQ(scan.points[3].z, -3.5F);
      EXPECT_EQ(scan.points[3].intensity, 203.0F);
      EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-7F), {0.0F, 0.03F, 0.06F, 0.09F}));
      EXPECT_EQ(scan.stamp_ns, 0);
      EXPECT_EQ(info.stamp_ns, kStamp);
      EXPECT_EQ(info.frame_id, "lidar");
      EXPECT_EQ(info.cells, 4U);
      EXPECT_EQ(info.times.name, "T");
      EXPECT_STREQ(info.times.unit, "ns");
      EXPECT_THAT(info.fields, HasSubstr("ring (uint16), z (float64), y (float32)"));
      EXPECT_EQ(LidarMessageStamp(Topic("sensor_msgs/PointCloud2", form),
                                  bytes.substr(0, kHeadBytes), "a"),
                kStamp);
    }
  }
}

// One row of x y z (float32) and a field of times of this type.
template <typename Time>
std::string TimedCloud(const std::string& name, std::uint8_t datatype,
                       const std::vector<Time>& times) {
  std::string data;
  for (const Time time : times) data += Pack(1.0F, 2.0F, 3.0F, time);
  const std::vector<WrittenField> fields = {
      {"x", 0, 7}, {"y", 4, 7}, {"z", 8, 7}, {name, 12, datatype}};
  const auto width = static_cast<std::uint32_t>(times.size());
  const auto step = static_cast<std::uint32_t>(12 + sizeof(Time));
  return CloudMessage(Form::kCdr, kStamp, fields, 1, width, step, step * width, data);
}

TEST(LidarMessage, TimesUnderEveryNameAndUnit) {
  const auto expect = [](const std::string& message, StampNs clock, std::vector<float> times) {
    const Scan scan = ReadCloud(Form::kCdr, message);
    EXPECT_NEAR(static_cast<double>(scan.stamp_ns - clock), 0.0, 300.0);
    EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-6F), times));
  };
  expect(TimedCloud<float>("time", 7, {-0.1F, -0.05F, 0.0F}), 0, {-0.1F, -0.05F, 0.0F});
  expect(TimedCloud<std::uint32_t>("offset_time", 6, {0, 50'000'000}), 0, {0.0F, 0.05F});
  expect(TimedCloud<std::uint32_t>("t", 6, {100, 50'100}), 0, {0.0001F, 0.0501F});
  expect(TimedCloud<double>("time_stamp", 8, {0.0, 98.5}), 0, {0.0F, 0.0985F});
  const auto now = static_cast<double>(kStamp);
  expect(TimedCloud<double>("timestamp", 8, {1e-9 * now, 1e-9 * now + 0.1}), kStamp, {0.0F, 0.1F});
  expect(TimedCloud<double>("TimeStamp", 8, {now, now + 1e8}), kStamp, {0.0F, 0.1F});
}

TEST(LidarMessage, PointsWithoutAReturnAreLeftOut) {
  // Their times would not fit the others.
  std::string data;
  const float t[] = {0.0F, 5e8F, 0.05F, -7e8F};
  const float x[] = {1.0F, 0.0F, 2.0F, kNan};
  for (int i = 0; i < 4; ++i) data += Pack(x[i], 0.0F, 0.0F, 9.0F * x[i], t[i]);
  const std::vector<WrittenField> fields = {
      {"x", 0}, {"y", 4}, {"z", 8}, {"intensity", 12}, {"t", 16}};
  LidarMessageInfo info;
  const Scan scan =
      ReadCloud(Form::kRos1, CloudMessage(Form::kRos1, kStamp, fields, 2, 2, 20, 40, data), &info);
  EXPECT_THAT(Xs(scan), ElementsAre(1.0F, 2.0F));
  EXPECT_EQ(scan.points[1].intensity, 18.0F);
  EXPECT_THAT(scan.time_s, ElementsAre(0.0F, 0.05F));
  EXPECT_EQ(info.cells, 4U);
}

TEST(LidarMessage, LivoxOfBothDrivers) {
  for (const Form form : {Form::kRos1, Form::kCdr}) {
    WireWriter out(form);
    out.Header(kStamp).Add(static_cast<std::uint64_t>(kStamp - 1000)).Add(3U);
    out.Add(std::uint8_t{100}).Raw(std::string(3, '\0')).Add(3U);
    for (std::uint32_t i = 0; i < 3; ++i) {
      const float x = i == 1 ? 0.0F : 5.0F + static_cast<float>(i);
      out.Add(i * 20'000'000U).Add(x).Add(0.0F).Add(0.0F);
      out.Add(static_cast<std::uint8_t>(40 + i)).Add(std::uint8_t{0}).Add(std::uint8_t{0});
    }
    const std::string type =
        form == Form::kRos1 ? "livox_ros_driver/CustomMsg" : "livox_ros_driver2/CustomMsg";
    LidarMessageInfo info;
    const Scan scan =
        ScanFromMessage(Topic(type, form), out.Bytes(), PointTimeUnit::kAuto, "a", &info);
    EXPECT_EQ(scan.stamp_ns, kStamp - 1000);
    EXPECT_THAT(Xs(scan), ElementsAre(5.0F, 7.0F));
    EXPECT_THAT(scan.time_s, ElementsAre(0.0F, 0.04F));
    EXPECT_EQ(scan.points[1].intensity, 42.0F);
    EXPECT_EQ(info.cells, 3U);
    EXPECT_TRUE(info.times.usable);
    for (std::size_t size = 0; size < out.Bytes().size(); ++size) {
      EXPECT_THROW(ScanFromMessage(Topic(type, form), out.Bytes().substr(0, size),
                                   PointTimeUnit::kAuto, "a", nullptr),
                   InputError);
    }
  }
}

TEST(LidarMessage, WhatContradictsItselfIsRefused) {
  const std::vector<WrittenField> xyz = {{"x", 0}, {"y", 4}, {"z", 8}};
  const std::string data(60, '\1');
  const auto complaint = [&](const std::vector<WrittenField>& fields, std::uint32_t height,
                             std::uint32_t width, std::uint32_t step, std::uint32_t row) {
    return MessageOf<InputError>([&] {
      ReadCloud(Form::kRos1,
                CloudMessage(Form::kRos1, kStamp, fields, height, width, step, row, data));
    });
  };
  EXPECT_THAT(complaint(xyz, 1, 6, 12, 72), HasSubstr("a.bag#3: is damaged: too few data"));
  EXPECT_THAT(complaint(xyz, 0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0), HasSubstr("too few data"));
  EXPECT_THAT(complaint(xyz, 0xFFFFFFFF, 1, 12, 12), HasSubstr("too few data"));
  EXPECT_THAT(complaint(xyz, 1, 5, 0, 0), HasSubstr("points of no bytes"));
  EXPECT_THAT(complaint(xyz, 0, 5, 12, 60), HasSubstr("is empty"));
  EXPECT_THAT(complaint(xyz, 1, 6, 10, 60), HasSubstr("field 'z' at byte 8 of points of 10"));
  EXPECT_THAT(complaint({{"x", 0}, {"y", 4}, {"z", 0xFFFFFFF8}}, 1, 5, 12, 60),
              HasSubstr("field 'z' at byte"));
  EXPECT_THAT(complaint({{"x", 0}, {"y", 4}}, 1, 5, 12, 60), HasSubstr("has no field 'z'"));
  EXPECT_THAT(complaint({{"x", 0}, {"y", 4}, {"z", 8, 5}}, 1, 5, 12, 60),
              HasSubstr("float or double"));
  EXPECT_THAT(complaint({{"x", 0}, {"y", 4}, {"z", 8}, {"t", 0, 11}}, 1, 5, 12, 60),
              HasSubstr("unknown type 11"));
  // Of a driver that leaves row_step out, and one that counts points in it.
  for (const std::uint32_t row : {0U, 5U, 999U}) {
    EXPECT_THAT(
        ReadCloud(Form::kRos1, CloudMessage(Form::kRos1, kStamp, xyz, 1, 5, 12, row, data)).points,
        SizeIs(5));
  }
}

TEST(LidarMessage, CutMessagesAreRefused) {
  Scan scan;
  scan.points = {{1, 2, 3, 4}, {5, 6, 7, 8}};
  for (const Form form : {Form::kRos1, Form::kCdr, Form::kCdrBigEndian}) {
    const std::string bytes = CloudMessage(form, kStamp, scan);
    EXPECT_THAT(ReadCloud(form, bytes).time_s, IsEmpty());
    for (std::size_t size = 0; size + 1 < bytes.size(); ++size) {
      EXPECT_THROW(ReadCloud(form, bytes.substr(0, size)), InputError) << size;
    }
  }
  EXPECT_THAT(MessageOf<InputError>([&] {
                std::string bytes = CloudMessage(Form::kCdr, kStamp, scan);
                bytes[1] = 3;
                ReadCloud(Form::kCdr, bytes);
              }),
              HasSubstr("a form of CDR that is not read"));
}

}  // namespace
}  // namespace lamina
