#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/io/gltf/gltf_import_builder.h"
#include "tests/support/paths.h"

namespace anigen::test {

/// Saves a hand-written file and imports it; the result must be sound.
inline io::ImportedAsset import_built(const GltfBuilder& file, const io::ImportOptions& options = {}) {
  const TemporaryFolder folder;
  file.save(folder / "file.gltf");
  io::ImportedAsset imported = io::read_gltf(folder / "file.gltf", options);
  EXPECT_TRUE(validate(imported.asset).empty());
  return imported;
}

/// The public rigs that are glTF, in order; none where the assets are not there.
inline std::vector<std::filesystem::path> rigged_files() {
  std::vector<std::filesystem::path> files;
  std::error_code error;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(assets_dir() / "rigged", error)) {
    if (entry.path().extension() == ".glb" || entry.path().extension() == ".gltf") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// Vertex v on joints v, v + 1, … of as many.
inline SkinWeights cyclic_weights(std::size_t vertices, std::size_t joints, std::size_t influences = 2) {
  SkinWeights skin;
  for (std::size_t v = 0; v < vertices; ++v) {
    std::vector<Influence> row;
    for (std::size_t k = 0; k < influences; ++k)
      row.push_back({static_cast<std::int32_t>((v + k) % joints), 1.0F / static_cast<float>(k + 1)});
    skin.append_row(row);
  }
  return skin;
}

inline bool has_note(const io::ImportedAsset& imported, const std::string& code) {
  for (const io::ImportNote& note : imported.notes) {
    if (note.code == code) return true;
  }
  return false;
}

/// The number a note starts with; 0 when there is no such note.
inline std::size_t note_count(const io::ImportedAsset& imported, const std::string& code) {
  for (const io::ImportNote& note : imported.notes) {
    if (note.code == code) return std::stoul(note.message);
  }
  return 0;
}

/// Expects an InputError whose place and problem contain these words.
inline void expect_refused(const GltfBuilder& file, const std::string& place, const std::string& problem,
                           const io::ImportOptions& options = {}) {
  const TemporaryFolder folder;
  file.save(folder / "file.glb");
  try {
    io::read_gltf(folder / "file.glb", options);
    ADD_FAILURE() << "accepted; expected an error about: " << problem;
  } catch (const InputError& error) {
    EXPECT_NE(error.place().find(place), std::string::npos) << error.what();
    EXPECT_NE(error.problem().find(problem), std::string::npos) << error.what();
    EXPECT_EQ(error.file(), (folder / "file.glb").string());
  }
}

}  // namespace anigen::test
