#pragma once
#include <cstdint>
#include <vector>

#include "anigen/io/gltf/document.h"

namespace anigen::io::gltf_import {

/// The numbers of an accessor, row-major [count, width], sparse replacements applied. Normalised integers become
/// [0, 1] or [-1, 1] (glTF 2.0, section 3.6.2.2: max(c / 127, -1) and so on).
/// @param at_most read only this many elements @throws InputError when a sparse index is out of range
std::vector<float> read_floats(const Document& document, int accessor);
std::vector<double> read_doubles(const Document& document, int accessor, std::size_t at_most = ~std::size_t{0});

/// As above, for unsigned integers, never normalised. @pre the component is kU8, kU16 or kU32
std::vector<std::uint32_t> read_unsigned(const Document& document, int accessor);

/// Factor of a normalised integer of this component.
double normalized_scale(Component component);

}  // namespace anigen::io::gltf_import
