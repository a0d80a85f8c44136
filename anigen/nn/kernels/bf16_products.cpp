#include "anigen/nn/kernels/bf16_products.h"

#include <algorithm>
#include <array>
#include <cstdlib>

namespace anigen::nn::kernels {

#if ANIGEN_BF16_X86

namespace {

#define ANIGEN_AMX __attribute__((target("amx-tile,amx-bf16")))

constexpr std::int64_t kAmxRows = 16, kAmxPairs = 16, kAmxColumns = 16;  // of a full tile
constexpr std::int64_t kFewestAmxRows = 8;                               // with fewer, AVX512-BF16 is as fast
constexpr std::int64_t kFactorBytes = 2, kPairBytes = 4, kSumBytes = 4;
constexpr std::int64_t kAsksOfStep = 12;  // tiles of 6 rows and 8 pairs in one of 32 rows and 16 pairs

// GCC 12 does not know what the instructions of AMX read and write: until here all is in memory.
void write_back_memory() { asm volatile("" : : : "memory"); }

// Operand of LDTILECFG.
struct TileConfig {
  std::uint8_t palette = 1, start_row = 0, reserved[14] = {};
  std::uint16_t row_bytes[16] = {};
  std::uint8_t rows[16] = {};
};
static_assert(sizeof(TileConfig) == 64);

// Tiles 0 to 3 hold sums, two by two; 4 and 5 factors of the upper and lower rows; 6 and 7 columns of b.
ANIGEN_AMX void configure_tiles(std::int64_t upper_rows, std::int64_t lower_rows, std::int64_t pairs) {
  TileConfig config;
  const auto set = [&](int tile, std::int64_t rows, std::int64_t row_bytes) {
    config.rows[tile] = static_cast<std::uint8_t>(rows);
    config.row_bytes[tile] = static_cast<std::uint16_t>(rows == 0 ? 0 : row_bytes);
  };
  for (const int tile : {0, 1}) set(tile, upper_rows, kSumBytes * kAmxColumns);
  for (const int tile : {2, 3}) set(tile, lower_rows, kSumBytes * kAmxColumns);
  set(4, upper_rows, kPairBytes * pairs);
  set(5, lower_rows, kPairBytes * pairs);
  for (const int tile : {6, 7}) set(tile, pairs, kPairBytes * kAmxColumns);
  asm volatile("" : : "m"(config));  // GCC 12 knows of its first eight bytes alone
  _tile_loadconfig(&config);
}

ANIGEN_AMX void release_tiles() { _tile_release(); }

// Up to 32 rows by one or two vectors of columns. @param steps numbers of pairs that the tiles are configured for
template <bool kLower, bool kRight>
ANIGEN_AMX void multiply_block(const Bf16Product& product, std::int64_t b_vectors, bool adds, std::int64_t steps,
                               products::RowsAhead& ahead) {
  const auto sum_bytes = static_cast<std::size_t>(kSumBytes * product.sum_stride);
  const auto factor_bytes = static_cast<std::size_t>(kFactorBytes * product.factor_stride);
  const auto b_bytes = static_cast<std::size_t>(kPairBytes * kAmxColumns * b_vectors);
  float* const lower = product.sums + kAmxRows * product.sum_stride;
  if (adds) {
    _tile_loadd(0, product.sums, sum_bytes);
    if (kRight) _tile_loadd(1, product.sums + kAmxColumns, sum_bytes);
    if (kLower) _tile_loadd(2, lower, sum_bytes);
    if (kLower && kRight) _tile_loadd(3, lower + kAmxColumns, sum_bytes);
  } else {
    _tile_zero(0);
    if (kRight) _tile_zero(1);
    if (kLower) _tile_zero(2);
    if (kLower && kRight) _tile_zero(3);
  }
  const std::uint16_t *factors = product.factors, *b = product.b;
  for (std::int64_t step = 0; step < steps; ++step) {
    _tile_loadd(4, factors, factor_bytes);
    _tile_loadd(6, b, b_bytes);
    _tile_dpbf16ps(0, 4, 6);
    if (kRight) {
      _tile_loadd(7, b + 2 * kAmxColumns, b_bytes);
      _tile_dpbf16ps(1, 4, 7);
    }
    if (kLower) {
      _tile_loadd(5, factors + kAmxRows * product.factor_stride, factor_bytes);
      _tile_dpbf16ps(2, 5, 6);
      if (kRight) _tile_dpbf16ps(3, 5, 7);
    }
    factors += 2 * kAmxPairs;
    b += 2 * kAmxPairs * kAmxColumns * b_vectors;
    for (std::int64_t i = ahead.left() > 0 ? kAsksOfStep : 0; i > 0; --i) ahead.ask();
  }
  _tile_stored(0, product.sums, sum_bytes);
  if (kRight) _tile_stored(1, product.sums + kAmxColumns, sum_bytes);
  if (kLower) _tile_stored(2, lower, sum_bytes);
  if (kLower && kRight) _tile_stored(3, lower + kAmxColumns, sum_bytes);
}

// All columns of up to 32 rows.
void multiply_tile_rows(Bf16Product product, bool adds, std::int64_t steps, products::RowsAhead& ahead) {
  const bool has_lower = product.rows > kAmxRows;
  for (std::int64_t vector = 0; vector < product.vectors; vector += 2) {
    const bool has_right = vector + 1 < product.vectors;
    const auto block = has_lower ? (has_right ? multiply_block<true, true> : multiply_block<true, false>)
                                 : (has_right ? multiply_block<false, true> : multiply_block<false, false>);
    block(product, product.vectors, adds, steps, ahead);
    product.b += 4 * kAmxColumns;
    product.sums += 2 * kAmxColumns;
  }
}

ANIGEN_BF16_BEGIN

template <int kVectors>
ANIGEN_BF16 void multiply_vectors(const Bf16Product& product, bool adds, products::RowsAhead& ahead) {
  const auto from = [&](std::int64_t r) { return product.factors + r * product.factor_stride; };
  const auto to = [&](std::int64_t r) { return product.sums + r * product.sum_stride; };
  if (adds) {
    bf16_rows<kVectors, true>(from, to, product.rows, product.pairs, product.b, ahead);
  } else {
    bf16_rows<kVectors, false>(from, to, product.rows, product.pairs, product.b, ahead);
  }
}

ANIGEN_BF16_END

}  // namespace

// All rows. @param pairs of a tile; a divisor of those of the product
void Bf16Multiplier::multiply_tiles_of(Bf16Product product, bool adds, std::int64_t pairs, products::RowsAhead& ahead) {
  const std::int64_t all = product.rows, steps = product.pairs / pairs;
  for (std::int64_t row = 0; row < all; row += product.rows) {
    product.rows = std::min(2 * kAmxRows, all - row);
    if (product.rows != rows_ || pairs != pairs_) {
      const std::int64_t upper = std::min(kAmxRows, product.rows);
      configure_tiles(upper, product.rows - upper, pairs);
      rows_ = product.rows;
      pairs_ = pairs;
    }
    multiply_tile_rows(product, adds, steps, ahead);
    product.factors += product.rows * product.factor_stride;
    product.sums += product.rows * product.sum_stride;
  }
}

void Bf16Multiplier::multiply_tiles(const Bf16Product& product, bool adds, products::RowsAhead& ahead) {
  write_back_memory();
  const std::int64_t rest = product.pairs % kAmxPairs;
  Bf16Product part = product;
  part.pairs -= rest;
  if (part.pairs > 0) {
    multiply_tiles_of(part, adds, kAmxPairs, ahead);
    part.factors += 2 * part.pairs;
    part.b += 2 * part.pairs * kAmxColumns * part.vectors;
    adds = true;
  }
  if (rest > 0) {
    part.pairs = rest;
    multiply_tiles_of(part, adds, rest, ahead);
  }
  write_back_memory();
}

void Bf16Multiplier::multiply(const Bf16Product& product, bool adds, products::RowsAhead& ahead) {
  if (has_amx_products() && product.rows >= kFewestAmxRows) return multiply_tiles(product, adds, ahead);
  static constexpr auto kForms =
      std::array{multiply_vectors<1>, multiply_vectors<2>, multiply_vectors<3>, multiply_vectors<4>};
  kForms[static_cast<std::size_t>(product.vectors - 1)](product, adds, ahead);
}

// A thread that holds tiles is slower to switch.
Bf16Multiplier::~Bf16Multiplier() {
  if (rows_ > 0) release_tiles();
}

#else

void Bf16Multiplier::multiply(const Bf16Product&, bool, products::RowsAhead&) {
  std::abort();  // has_bf16_products() said no
}

Bf16Multiplier::~Bf16Multiplier() = default;

#endif

void Bf16Multiplier::multiply(const Bf16Product& product, bool adds) {
  products::RowsAhead nothing;
  multiply(product, adds, nothing);
}

}  // namespace anigen::nn::kernels
