#pragma once
#include <CGAL/AABB_tree.h>
#if __has_include(<CGAL/AABB_traits_3.h>)
#include <CGAL/AABB_traits_3.h>
#include <CGAL/AABB_triangle_primitive_3.h>
#else
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_triangle_primitive.h>
#endif

namespace anigen::benchmarks {

/// Classes of CGAL's tree of boxes, which CGAL 6 calls by other names.
#if __has_include(<CGAL/AABB_traits_3.h>)
template <typename Kernel, typename Iterator>
using CgalPrimitive = CGAL::AABB_triangle_primitive_3<Kernel, Iterator>;
template <typename Kernel, typename Primitive>
using CgalTraits = CGAL::AABB_traits_3<Kernel, Primitive>;
#else
template <typename Kernel, typename Iterator>
using CgalPrimitive = CGAL::AABB_triangle_primitive<Kernel, Iterator>;
template <typename Kernel, typename Primitive>
using CgalTraits = CGAL::AABB_traits<Kernel, Primitive>;
#endif

}  // namespace anigen::benchmarks
