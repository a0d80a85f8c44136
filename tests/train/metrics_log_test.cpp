#include <gtest/gtest.h>
#include <cmath>
#include <cstring>
#include <fstream>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/train/metrics_log.h"
#include "tests/support/paths.h"

namespace anigen::train {

namespace {

TEST(MetricsLog, NewQuantitiesBecomeColumns) {
  const test::TemporaryFolder folder;
  MetricsLog log(folder / "metrics.csv", 0);
  log.append(10, {{"loss", 0.5}});
  log.append(20, {{"eval.l1", 0.25}});
  log.append(30, {{"loss", std::nan("")}, {"eval.l1", 1e-7}});
  EXPECT_EQ(read_file(folder / "metrics.csv"), "step,loss,eval.l1\n10,0.5,\n20,,0.25\n30,nan,1e-07\n");
}

TEST(MetricsLog, ResumingDropsLaterRowsAndATornLine) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "metrics.csv") << "step,loss\n10,3\n20,2\n30,1\n40,0";
  MetricsLog log(folder / "metrics.csv", 20);
  log.append(30, {{"loss", 7}});
  EXPECT_EQ(read_file(folder / "metrics.csv"), "step,loss\n10,3\n20,2\n30,7.0\n");
}

TEST(MetricsLog, AnotherFileIsRefused) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "metrics.csv") << "sha256,x\na,1\n";
  EXPECT_THROW(MetricsLog(folder / "metrics.csv", 0), InputError);
}

TEST(RunningMeans, StepsThatAreNotFiniteDoNotCount) {
  RunningMeans means;
  for (const double value : {1.0, std::nan(""), 3.0}) means.add("a", value);
  means.add("b", std::nan(""));
  EXPECT_EQ(means.means()[0].second, 2.0);
  EXPECT_TRUE(std::isnan(means.means()[1].second));
}

}  // namespace

namespace {

// Reads a protobuf message one field at a time, independently of the writer.
struct Message {
  std::string bytes;
  std::size_t at = 0;
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (int shift = 0;; shift += 7) {
      const auto byte = static_cast<unsigned char>(bytes.at(at++));
      value |= static_cast<std::uint64_t>(byte & 0x7F) << shift;
      if (byte < 0x80) return value;
    }
  }
  bool next(std::uint64_t& field, std::string& payload, std::uint64_t& number) {
    if (at >= bytes.size()) return false;
    const std::uint64_t key = varint();
    field = key >> 3;
    switch (key & 7) {
      case 0:
        number = varint();
        break;
      case 1:
        payload = bytes.substr(at, 8), at += 8;
        break;
      case 2: {
        const std::uint64_t n = varint();
        payload = bytes.substr(at, n), at += n;
        break;
      }
      default:
        payload = bytes.substr(at, 4), at += 4;
        break;
    }
    return true;
  }
  // The last occurrence of a length-delimited or fixed field.
  std::string part(std::uint64_t wanted) const {
    Message copy{bytes};
    std::string payload, found;
    std::uint64_t field = 0, number = 0;
    while (copy.next(field, payload, number)) {
      if (field == wanted) found = payload;
    }
    return found;
  }
  std::uint64_t integer(std::uint64_t wanted) const {
    Message copy{bytes};
    std::string payload;
    std::uint64_t field = 0, number = 0, found = 0;
    while (copy.next(field, payload, number)) {
      if (field == wanted) found = number;
    }
    return found;
  }
};

std::vector<Message> events(const std::string& file) {
  std::vector<Message> result;
  for (std::size_t at = 0; at < file.size();) {
    std::uint64_t length = 0;
    std::uint32_t length_crc = 0, data_crc = 0;
    std::memcpy(&length, file.data() + at, 8);
    std::memcpy(&length_crc, file.data() + at + 8, 4);
    EXPECT_EQ(length_crc, masked_crc32c(file.substr(at, 8)));
    const std::string data = file.substr(at + 12, length);
    std::memcpy(&data_crc, file.data() + at + 12 + length, 4);
    EXPECT_EQ(data_crc, masked_crc32c(data));
    result.push_back({data});
    at += 16 + length;
  }
  return result;
}

// RFC 3720, B.4, gives these checksums.
TEST(Crc32c, KnownValues) {
  EXPECT_EQ(crc32c("123456789"), 0xE3069283u);
  EXPECT_EQ(crc32c(std::string(32, '\0')), 0x8A9136AAu);
  EXPECT_EQ(crc32c(std::string(32, '\xFF')), 0x62A8AB43u);
}

TEST(TensorBoardWriter, ScalarsAndPicturesReadBack) {
  const test::TemporaryFolder folder;
  std::filesystem::path path;
  {
    TensorBoardWriter writer(folder / "tb", 7);
    path = writer.path();
    writer.scalar("loss/kl", 0.25, 300);
    writer.image("preview", {1, 2, 3, 4}, 20, 10, 301);
  }
  EXPECT_EQ(path.filename().string().rfind("events.out.tfevents.", 0), 0u) << "TensorBoard looks for this name";
  const std::vector<Message> all = events(read_file(path));
  ASSERT_EQ(all.size(), 4u);
  EXPECT_EQ(all[0].part(3), "brain.Event:2");
  EXPECT_EQ(all[1].integer(2), 7u);
  EXPECT_EQ(Message{all[1].part(7)}.integer(1), 1u) << "session start, from which older entries are purged";
  const Message value{Message{all[2].part(5)}.part(1)};
  float number = 0;
  std::memcpy(&number, value.part(2).data(), 4);
  EXPECT_EQ(value.part(1), "loss/kl");
  EXPECT_EQ(number, 0.25f);
  EXPECT_EQ(all[2].integer(2), 300u);
  const Message picture{Message{Message{all[3].part(5)}.part(1)}.part(4)};
  EXPECT_EQ(picture.integer(1), 10u);
  EXPECT_EQ(picture.integer(2), 20u);
  EXPECT_EQ(picture.part(4), std::string("\1\2\3\4"));
}

}  // namespace

}  // namespace anigen::train
