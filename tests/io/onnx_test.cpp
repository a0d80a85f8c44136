#include "anigen/io/onnx.h"

#include <gtest/gtest.h>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "tests/support/onnx_files.h"
#include "tests/support/paths.h"

namespace anigen::io {

namespace {

TEST(Onnx, DamagedFilesGiveErrorsOnly) {
  const std::string whole = test::onnx_bytes(test::channel_sum_network(8, {1, 0, 0}));
  const test::TemporaryFolder folder;
  const auto path = folder / "damaged.onnx";
  const auto read = [&](const std::string& bytes) {
    write_file_atomically(path, bytes);
    try {
      read_onnx_signature(path);
    } catch (const InputError&) {
    }
  };
  for (std::size_t length = 0; length < whole.size(); ++length) read(whole.substr(0, length));
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const int value : {0x00, 0x7F, 0x80, 0xFF}) {
      std::string damaged = whole;
      damaged[at] = static_cast<char>(value);
      read(damaged);
    }
  }
  write_file_atomically(path, whole);
  const OnnxSignature signature = read_onnx_signature(path);
  ASSERT_EQ(signature.inputs.size(), 1u);
  EXPECT_EQ(signature.inputs[0].name, "picture");
  EXPECT_EQ(signature.inputs[0].shape, (std::vector<std::int64_t>{1, 3, 8, 8}));
  ASSERT_EQ(signature.outputs.size(), 1u);
  EXPECT_EQ(signature.outputs[0].name, "mask");
}

TEST(Onnx, DamagedHalfPrecisionGivesErrorsOnly) {
  test::OnnxFile file = test::channel_sum_network(8, {1, 0, 0});
  file.weights.front().half = true;
  const std::string whole = test::onnx_bytes(file);
  for (std::size_t length = 0; length < whole.size(); ++length) {
    try {
      onnx_in_full_precision(whole.substr(0, length), "damaged.onnx");
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), "damaged.onnx");
    }
  }
  Rng rng(3, "damage");
  for (int round = 0; round < 2000; ++round) {
    std::string changed = whole;
    changed[rng.index(changed.size())] = static_cast<char>(rng.index(256));
    try {
      onnx_in_full_precision(changed, "damaged.onnx");
    } catch (const InputError& error) {
      EXPECT_EQ(error.file(), "damaged.onnx");
    }
  }
}

}  // namespace

}  // namespace anigen::io
