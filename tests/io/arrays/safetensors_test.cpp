#include <gtest/gtest.h>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/process.h"
#include "anigen/io/arrays/safetensors.h"
#include "tests/io/arrays/array_file_bytes.h"

namespace anigen::io {

namespace {

using test::little;

std::string with_header(const std::string& header, const std::string& data = "") {
  return little(header.size(), 8) + header + data;
}

class Safetensors : public ::testing::Test {
 protected:
  SafetensorsFile read(const std::string& bytes) {
    write_file_atomically(folder_ / "x.safetensors", bytes);
    return read_safetensors(folder_ / "x.safetensors");
  }
  std::string problem(const std::string& bytes) {
    try {
      read(bytes);
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  }
  test::TemporaryFolder folder_;
};

TEST_F(Safetensors, RoundTripsEveryDtype) {
  NamedArrays tensors;
  for (int d = 0; d <= static_cast<int>(Dtype::kF64); ++d) {
    const auto dtype = static_cast<Dtype>(d);
    NdArray array{dtype, {3, 1}, {}};
    for (std::size_t i = 0; i < 3 * size_of(dtype); ++i) array.bytes.push_back(static_cast<std::uint8_t>(i + d));
    tensors.emplace_back(std::string("tensor.") + name_of(dtype), array);
  }
  tensors.emplace_back("scalar", NdArray::from<float>({std::nanf("")}, {}));
  tensors.emplace_back("empty", NdArray::from<float>({}, {0, 7}));
  write_safetensors(folder_ / "a.safetensors", tensors, {{"format", "pt"}, {"quote", "\"ü"}});
  const SafetensorsFile file = read_safetensors(folder_ / "a.safetensors");
  ASSERT_EQ(file.tensors.size(), tensors.size());
  for (std::size_t i = 0; i < tensors.size(); ++i) {
    EXPECT_EQ(file.tensors[i].first, tensors[i].first);
    EXPECT_EQ(file.tensors[i].second.dtype, tensors[i].second.dtype);
    EXPECT_EQ(file.tensors[i].second.shape, tensors[i].second.shape);
    EXPECT_EQ(file.tensors[i].second.bytes, tensors[i].second.bytes);
  }
  EXPECT_EQ(file.metadata.at("quote"), "\"ü");
}

TEST_F(Safetensors, WritesTheSameBytesAndAlignsTheData) {
  const NamedArrays tensors = {{"b", NdArray::from<float>({1, 2}, {2})}, {"a", NdArray::from<double>({3}, {1})}};
  write_safetensors(folder_ / "a.safetensors", tensors);
  write_safetensors(folder_ / "b.safetensors", tensors);
  const std::string bytes = read_file(folder_ / "a.safetensors");
  EXPECT_EQ(bytes, read_file(folder_ / "b.safetensors"));
  EXPECT_EQ(bytes.substr(1, 7), std::string(7, '\0'));
  EXPECT_EQ(static_cast<unsigned char>(bytes[0]) % 8, 0);
  EXPECT_EQ(bytes.substr(8, 5), "{\"b\":");
  EXPECT_EQ(bytes.substr(bytes.size() - 16, 4), little(0x3F800000, 4));
}

TEST_F(Safetensors, RefusesToWriteNonsense) {
  const NdArray one = NdArray::from<float>({1}, {1});
  EXPECT_THROW(write_safetensors(folder_ / "x", {{"a", one}, {"a", one}}), Error);
  EXPECT_THROW(write_safetensors(folder_ / "x", {{"__metadata__", one}}), Error);
  EXPECT_THROW(write_safetensors(folder_ / "x", {{"\xff", one}}), Error);
  EXPECT_THROW(write_safetensors(folder_ / "x", {{"a", NdArray{Dtype::kF32, {2}, {1}}}}), Error);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(Safetensors, ADiskThatRefusesIsNamedWithItsReason) {
  SandboxRights rights;
  rights.writable = {folder_.path()};
  rights.file_bytes = 1000;
  ProcessLimits limits;
  limits.sandbox = rights;
  const GuardedWork work = run_guarded(
      [&]() -> std::string {
        try {
          write_safetensors(folder_ / "large.safetensors",
                            {{"a", NdArray::from<float>(std::vector<float>(100'000), {100'000})}});
        } catch (const WriteError& error) {
          return error.what();
        }
        return "done";
      },
      limits);
  EXPECT_EQ(work.result, (folder_ / "large.safetensors").string() + ": cannot write: File too large");
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

TEST_F(Safetensors, RefusesDamage) {
  const auto entry = [](const std::string& dtype, const std::string& shape, const std::string& offsets) {
    return "{\"dtype\":\"" + dtype + "\",\"shape\":" + shape + ",\"data_offsets\":" + offsets + "}";
  };
  const std::string good = entry("F32", "[1]", "[0,4]");
  EXPECT_EQ(problem(with_header("{\"a\":" + good + "}", "1234")), "accepted");
  EXPECT_NE(problem("").find("byte 0"), std::string::npos);
  EXPECT_NE(problem(little(std::uint64_t{1} << 60, 8) + "{}").find("header length"), std::string::npos);
  EXPECT_NE(problem(with_header("[]")).find("byte 8"), std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":")).find("not valid JSON"), std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":31E872}")).find("beyond the largest double"), std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + good + "}", "123")).find("truncated"), std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + good + "}", "12345")).find("after the last tensor"), std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + good + ",\"b\":" + entry("F32", "[1]", "[2,6]") + "}", "123456"))
                .find("overlaps"),
            std::string::npos);
  EXPECT_NE(
      problem(with_header("{\"a\":" + good + ",\"b\":" + entry("F32", "[1]", "[5,9]") + "}", "123456789")).find("gap"),
      std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + entry("F32", "[2]", "[0,4]") + "}", "1234")).find("by its shape"),
            std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + entry("F32", "[-1]", "[0,4]") + "}", "1234")).find("-1"),
            std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + entry("F32", "[4294967296,4294967296]", "[0,0]") + "}")).find("overflows"),
            std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + entry("F32", "[1]", "[4,0]") + "}", "1234")).find("damaged"),
            std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + entry("F8_E5M2", "[1]", "[0,1]") + "}", "1"))
                .find("not supported: dtype F8_E5M2"),
            std::string::npos);
  EXPECT_NE(problem(with_header("{\"__metadata__\":{\"k\":1}}")).find("__metadata__"), std::string::npos);
  EXPECT_NE(problem(with_header("{\"a\":" + std::string(5000, '[') + std::string(5000, ']') + "}")).find("nested"),
            std::string::npos);
  EXPECT_THROW(read_safetensors(folder_ / "missing.safetensors"), InputError);
}

// A file of a terabyte that takes no room on the disk: its data cannot be read into memory.
TEST_F(Safetensors, MetadataIsReadWithoutTheData) {
  const std::uint64_t bytes = std::uint64_t{1} << 40;
  const std::string header = R"({"__metadata__":{"state":"here"},"a":{"dtype":"U8","shape":[1099511627776],)"
                             R"("data_offsets":[0,1099511627776]}})";
  const std::filesystem::path file = folder_ / "x.safetensors";
  write_file_atomically(file, with_header(header));
  std::filesystem::resize_file(file, 8 + header.size() + bytes);
  EXPECT_EQ(read_safetensors_metadata(file), (std::map<std::string, std::string>{{"state", "here"}}));
  std::filesystem::resize_file(file, 8 + header.size() + bytes - 1);
  EXPECT_THROW(read_safetensors_metadata(file), InputError) << "the header says more than the file holds";
  EXPECT_THROW(read_safetensors_metadata(folder_ / "missing.safetensors"), InputError);
}

TEST_F(Safetensors, DamagedFilesOnlyThrow) {
  const NamedArrays tensors = {{"weight", NdArray::from<float>({1, 2, 3, 4}, {2, 2})},
                               {"bias", NdArray::from<double>({3}, {1})}};
  write_safetensors(folder_ / "a.safetensors", tensors, {{"format", "pt"}});
  const int refused = test::read_damaged(read_file(folder_ / "a.safetensors"), "x.safetensors",
                                         [](const auto& path) { read_safetensors(path); });
  EXPECT_GT(refused, 100);  // every cut file, and most damage to the header
}

/// Shapes and dtypes that a fixture's JSON lists under "inputs", "outputs" and "tensors".
void expect_listed(const Json& fixture, const NamedArrays& tensors, const std::string& name) {
  const auto check = [&](const std::string& key, const Json& listed) {
    if (!listed.is_object() || !listed.contains("shape") || !listed.contains("dtype")) return;
    const NdArray* array = find(tensors, key);
    ASSERT_NE(array, nullptr) << name << ": " << key;
    EXPECT_EQ(array->shape, listed["shape"].get<std::vector<std::int64_t>>()) << name << ": " << key;
    EXPECT_EQ(name_of(array->dtype), listed["dtype"].get<std::string>()) << name << ": " << key;
  };
  for (const auto& [section, prefix] :
       {std::pair("inputs", "in."), std::pair("outputs", "out."), std::pair("tensors", "")}) {
    if (!fixture.contains(section) || !fixture[section].is_object()) continue;
    for (const auto& [key, listed] : fixture[section].items()) check(prefix + key, listed);
  }
}

namespace fs = std::filesystem;

// The JSON files of a folder of fixtures; none where it does not exist.
std::vector<fs::path> fixtures_in(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder, none)) {
    if (entry.path().extension() == ".json") files.push_back(entry.path());
  }
  return files;
}

// The safetensors files of a fixture.
std::vector<fs::path> files_of(const Json& fixture, const fs::path& file) {
  std::vector<std::string> names;
  if (fixture.contains("files")) {
    names = fixture["files"].get<std::vector<std::string>>();
  } else if (fs::exists(fs::path(file).replace_extension(".safetensors"))) {
    names = {file.stem().string() + ".safetensors"};
  }
  std::vector<fs::path> files;
  for (const std::string& name : names) {
    if (fs::path(name).extension() == ".safetensors") files.push_back(file.parent_path() / name);
  }
  return files;
}

TEST(SafetensorsFixtures, AgreeWithTheirListings) {
  int fixtures = 0;
  for (const fs::path& folder : test::parity_dirs()) {
    for (const fs::path& file : fixtures_in(folder)) {
      const Json fixture = read_json(file);
      NamedArrays tensors;
      for (const fs::path& arrays : files_of(fixture, file)) {
        for (auto& tensor : read_safetensors(arrays).tensors) tensors.push_back(std::move(tensor));
      }
      if (tensors.empty()) continue;
      expect_listed(fixture, tensors, file.string());
      ++fixtures;
    }
  }
  if (fixtures == 0) {
    GTEST_SKIP() << "no parity fixtures";
  }
}

// The folder of this repository: every file that a fixture names is there and no other, and none is large.
TEST(SafetensorsFixtures, TheRepositoryHoldsSmallWholeOnes) {
  constexpr std::uintmax_t kMostOfOne = 400 * 1024, kMostOfAll = std::uintmax_t{16} << 20;
  const fs::path folder = test::source_dir() / "tests" / "data" / "parity";
  std::set<fs::path> wanted;
  for (const fs::path& file : fixtures_in(folder)) {
    std::uintmax_t bytes = fs::file_size(file);
    for (const fs::path& arrays : files_of(read_json(file), file)) {
      ASSERT_TRUE(fs::exists(arrays)) << arrays;
      wanted.insert(arrays);
      bytes += fs::file_size(arrays);
    }
    EXPECT_LE(bytes, kMostOfOne) << file;
  }
  EXPECT_GE(wanted.size(), 80U);
  std::uintmax_t all = 0;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    all += entry.file_size();
    if (entry.path().extension() == ".safetensors") {
      EXPECT_EQ(wanted.count(entry.path()), 1U) << entry.path() << " belongs to no fixture";
    }
  }
  EXPECT_LE(all, kMostOfAll);
}

// Both folders give the same result for a fixture of both.
TEST(SafetensorsFixtures, FoldersHoldTheSameBytes) {
  const fs::path here = test::source_dir() / "tests" / "data" / "parity";
  std::size_t compared = 0;
  for (const fs::path& folder : test::parity_dirs()) {
    std::error_code nothing;
    if (fs::equivalent(folder, here, nothing)) continue;
    for (const auto& entry : fs::recursive_directory_iterator(here)) {
      const fs::path other = folder / fs::relative(entry.path(), here);
      if (!entry.is_regular_file() || !fs::exists(other)) continue;
      if (entry.path().filename() == "README.md") continue;
      EXPECT_TRUE(read_file(entry.path()) == read_file(other)) << other;
      ++compared;
    }
  }
  if (compared == 0) {
    GTEST_SKIP() << "no larger folder of fixtures";
  }
}

}  // namespace

namespace {

class CheckpointFolder : public ::testing::Test {
 protected:
  void add(const std::string& name) { write_file_atomically(folder_ / "ckpts" / name, "x"); }
  std::string flow(bool ema) { return choose_flow_checkpoint(folder_.path(), ema).filename().string(); }
  test::TemporaryFolder folder_;
};

TEST_F(CheckpointFolder, StepsOfNames) {
  EXPECT_EQ(step_of("denoiser_step0000200.pt"), 200);
  EXPECT_EQ(step_of("denoiser_ema0.9999_step0001000.safetensors"), 1000);
  EXPECT_EQ(step_of("step5_step7.pt"), 7);
  EXPECT_EQ(step_of("denoiser.pt"), -1);
  EXPECT_EQ(step_of("denoiser_stepfinal.pt"), -1);
  EXPECT_EQ(step_of("denoiser_step99999999999999999999999.pt"), -1);
}

TEST_F(CheckpointFolder, HighestStepWinsNumerically) {
  add("denoiser_step9.pt");
  add("denoiser_step0000010.pt");
  add("denoiser.pt");
  add("denoiser_ema0.9999_step0000012.pt");
  add("misc_step0000099.pt");
  add("state_step0000099.safetensors");
  add("notes_step0000099.txt");
  EXPECT_EQ(flow(false), "denoiser_step0000010.pt");
  EXPECT_EQ(flow(true), "denoiser_ema0.9999_step0000012.pt");
}

TEST_F(CheckpointFolder, FilesOfKilledWritersDoNotCount) {
  add("denoiser_step0000010.safetensors");
  add("denoiser_step0000020.tmp-123-4.safetensors");
  add("state_step0000020.tmp-123-5.safetensors");
  EXPECT_EQ(flow(false), "denoiser_step0000010.safetensors");
  EXPECT_EQ(checkpoint_names(folder_ / "ckpts"), std::vector<std::string>{"denoiser_step0000010.safetensors"});
}

TEST_F(CheckpointFolder, SafetensorsCountAndPtWinsTies) {
  add("denoiser_step0000010.safetensors");
  EXPECT_EQ(flow(false), "denoiser_step0000010.safetensors");
  EXPECT_EQ(flow(true), "denoiser_step0000010.safetensors");
  add("denoiser_step0000010.pt");
  EXPECT_EQ(flow(false), "denoiser_step0000010.pt");
  add("denoiser_step0000011.safetensors");
  EXPECT_EQ(flow(false), "denoiser_step0000011.safetensors");
}

TEST_F(CheckpointFolder, NamedFiles) {
  add("final.pt");
  EXPECT_EQ(choose_checkpoint(folder_.path(), "decoder", "final").filename(), "final.pt");
  add("decoder_final.safetensors");
  add("encoder_final.pt");
  EXPECT_EQ(choose_checkpoint(folder_.path(), "decoder", "final").filename(), "decoder_final.safetensors");
  EXPECT_EQ(choose_checkpoint(folder_.path(), "encoder", "final").filename(), "encoder_final.pt");
  try {
    choose_checkpoint(folder_.path(), "decoder", "best");
    FAIL() << "a missing checkpoint was found";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("decoder_best.pt"), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find("encoder_final.pt"), std::string::npos) << error.what();
  }
}

TEST_F(CheckpointFolder, NothingToChoose) {
  EXPECT_THROW(choose_flow_checkpoint(folder_ / "missing", false), InputError);
  add("misc_step0000001.pt");
  EXPECT_THROW(flow(false), InputError);
  EXPECT_THROW(flow(true), InputError);
}

TEST(CheckpointFolderFixtures, ExpectedFiles) {
  const auto fixture = test::parity_file("ckpt_selection.json"), root = fixture.parent_path() / "ckpt_selection";
  if (!std::filesystem::exists(fixture)) {
    GTEST_SKIP() << "no " << fixture;
  }
  int checked = 0;
  const Json expectations = read_json(fixture)["config"]["expected_file"];
  for (const auto& [name, file] : expectations.items()) {
    const std::size_t dot = name.find('.');
    const std::string folder = name.substr(0, dot), preference = dot == std::string::npos ? "" : name.substr(dot + 1);
    const auto chosen = dot == std::string::npos ? choose_checkpoint(root / folder, "decoder", "final")
                                                 : choose_flow_checkpoint(root / folder, preference == "ema");
    EXPECT_EQ(chosen.filename().string(), file.get<std::string>()) << name;
    ++checked;
  }
  EXPECT_GT(checked, 0);
}

}  // namespace

}  // namespace anigen::io
