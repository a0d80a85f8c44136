#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/io/image.h"

namespace anigen::pipeline {

/// What becomes of the background of a picture.
enum class Background {
  kAuto,     ///< as published: alpha where there is some, else the network; GrabCut where no network is named
  kKeep,     ///< nothing is removed; an alpha channel still counts
  kAlpha,    ///< alpha, and an error for a picture that has none
  kGrabCut,  ///< GrabCut, even where there is alpha
  kNetwork   ///< the network, even where there is alpha
};

/// @param word auto, keep, alpha, grabcut or network @throws InputError for another one
Background parse_background(const std::string& word);

/// True when at least one pixel is not fully opaque: only then the published pipeline trusts alpha (reference
/// flows-and-pipeline.md, 5.2, step 2).
bool has_transparency(const io::Image& image);

/// The colours with alpha dropped, not blended: what lies hidden under transparent pixels is seen again.
io::Image without_alpha(const io::Image& image);

/// The picture with the mask as its alpha, composed over transparent black: colours are multiplied by the mask once, as
/// the published background remover does (reference flows-and-pipeline.md, 5.2).
/// @param image opaque @param mask [H · W]
io::Image cut_out(const io::Image& image, const std::vector<std::uint8_t>& mask);

/// Colours of one picture, alpha of another of the same size.
io::Image with_alpha_of(const io::Image& colors, const io::Image& alpha);

/// The longer side at most `longest` pixels: both sides times longest / longer, rounded down, at least 1 (Lanczos). A
/// picture without alpha is brought to 1024 so before its background is removed (reference flows-and-pipeline.md, 5.2,
/// step 2). @param image opaque
io::Image reduced(const io::Image& image, int longest);

}  // namespace anigen::pipeline
