// The bytes of a file against the format: header, records, arrays, footer.
#include "anigen/io/fbx/binary.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstring>

namespace anigen::io::fbx_export {
namespace {

constexpr std::size_t kHeader = 27, kNullRecord = 13;

std::size_t u32_at(const std::string& bytes, std::size_t offset) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

TEST(FbxBinary, BeginsAndEndsAsTheFormatWants) {
  std::list<Record> records;
  records.emplace_back("CreationTime").text(kCreationTime);
  const std::string file = file_bytes(records, "x.fbx");
  EXPECT_EQ(file.substr(0, 23), std::string("Kaydara FBX Binary  \0\x1a\0", 23));
  EXPECT_EQ(u32_at(file, 23), 7400u);
  // Footer: id, zeros up to a multiple of 16, version, 120 zeros, magic of 16 bytes.
  const std::size_t end_of_records = u32_at(file, kHeader) + kNullRecord;
  EXPECT_EQ(file.substr(end_of_records - kNullRecord, kNullRecord), std::string(kNullRecord, '\0'));
  EXPECT_EQ(static_cast<unsigned char>(file[end_of_records]), 0xfa);
  EXPECT_EQ(u32_at(file, file.size() - 140), 7400u);
  EXPECT_EQ((file.size() - 140) % 16, 0u);
  EXPECT_EQ(file.substr(file.size() - 136, 120), std::string(120, '\0'));
  EXPECT_EQ(static_cast<unsigned char>(file.back()), 0x0b);
}

TEST(FbxBinary, RecordsNestAndEndWhereTheySay) {
  std::list<Record> records;
  Record& outer = records.emplace_back("Outer").int32(7);
  outer.child("Inner").text("a").flag(true);
  outer.child("Empty");
  records.emplace_back("Last").real(0.5);
  const std::string file = file_bytes(records, "x.fbx");
  const std::size_t last = u32_at(file, kHeader);
  EXPECT_EQ(u32_at(file, kHeader + 4), 1u);
  EXPECT_EQ(u32_at(file, kHeader + 8), 5u);
  EXPECT_EQ(file.substr(kHeader + 12, 6), "\x05Outer");
  EXPECT_EQ(file[kHeader + 18], 'I');
  EXPECT_EQ(u32_at(file, kHeader + 19), 7u);
  const std::size_t inner = kHeader + 23, empty = u32_at(file, inner);
  EXPECT_EQ(u32_at(file, inner + 4), 2u);
  EXPECT_EQ(file.substr(inner + 12, 6), "\x05Inner");
  EXPECT_EQ(file.substr(inner + 18, 8), std::string("S\1\0\0\0aC\1", 8));
  EXPECT_EQ(empty, inner + 26);  // properties alone need no null record
  // A record of nothing ends with one, and so does the list of those inside `outer`.
  EXPECT_EQ(u32_at(file, empty), empty + 13 + 5 + kNullRecord);
  EXPECT_EQ(last, u32_at(file, empty) + kNullRecord);
  EXPECT_EQ(file.substr(last + 12, 6), std::string("\x04LastD"));
  double value = 0.0;
  std::memcpy(&value, file.data() + last + 18, sizeof value);
  EXPECT_EQ(value, 0.5);
}

TEST(FbxBinary, LongArraysAreCompressedShortOnesAreNot) {
  std::vector<double> values(1000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(i % 7);
  std::list<Record> records;
  records.emplace_back("A").array(values);
  records.emplace_back("B").array(std::vector<std::int32_t>{1, -2, 3});
  const std::string file = file_bytes(records, "x.fbx");
  const std::size_t array = kHeader + 14;
  EXPECT_EQ(file[array], 'd');
  EXPECT_EQ(u32_at(file, array + 1), values.size());
  ASSERT_EQ(u32_at(file, array + 5), 1u);
  std::vector<double> unpacked(values.size());
  uLongf size = unpacked.size() * sizeof(double);
  ASSERT_EQ(::uncompress(reinterpret_cast<Bytef*>(unpacked.data()), &size,
                         reinterpret_cast<const Bytef*>(file.data() + array + 13), u32_at(file, array + 9)),
            Z_OK);
  EXPECT_EQ(unpacked, values);
  const std::size_t plain = u32_at(file, kHeader) + 14;
  EXPECT_EQ(file[plain], 'i');
  EXPECT_EQ(u32_at(file, plain + 5), 0u);
  EXPECT_EQ(u32_at(file, plain + 9), 12u);
  EXPECT_EQ(u32_at(file, plain + 17), 0xFFFFFFFEu);
}

}  // namespace
}  // namespace anigen::io::fbx_export
