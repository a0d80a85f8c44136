#pragma once
#include <filesystem>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/io/image.h"

namespace anigen::data {

/// Backgrounds that need no files.
enum class Background {
  kFlat,
  kGradient,  ///< linear or radial
  kNoise,     ///< fractal value noise between two colours, of one octave or several
  kStripes,
  kChecker,
  kBlobs,   ///< blurred discs
  kHorizon  ///< a wall or sky above a floor, flat or checked in perspective
};

inline const Words<Background> kBackgrounds = {{Background::kFlat, "flat"},       {Background::kGradient, "gradient"},
                                               {Background::kNoise, "noise"},     {Background::kStripes, "stripes"},
                                               {Background::kChecker, "checker"}, {Background::kBlobs, "blobs"},
                                               {Background::kHorizon, "horizon"}};

/// A background with random colours, sizes and directions: a pure function of its arguments.
/// @return [3, S, S] in [0, 1]
std::vector<float> draw_background(Background kind, int size, Rng& rng);
/// As above, of a random kind.
std::vector<float> draw_background(int size, Rng& rng);

/// A random square of a picture, of a third of its shorter side up to all of it, mirrored and blurred at random.
/// @param picture its alpha does not count @return [3, S, S] in [0, 1]
std::vector<float> crop_background(const io::Image& picture, int size, Rng& rng);

/// Gaussian blur of planes, cut off at four deviations; mirrored at the edges, whose pixels are not repeated.
/// @param planes [C, S, S] @param sigma in pixels; below 0.1: none
void blur_planes(std::vector<float>& planes, int size, double sigma);

/// The pictures of a folder by name (io::picture_files), decoded at once and kept in memory.
/// @param longest the longer side is brought down to it, by Lanczos @param cut_out of pictures with transparency: each
/// is cropped around its object (io::condition_box) first
/// @throws InputError naming the file: no pictures, one that cannot be read, with cut_out one without transparency
std::vector<io::Image> read_pictures(const std::filesystem::path& folder, int longest, bool cut_out);

}  // namespace anigen::data
