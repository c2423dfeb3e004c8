// Reads an OpenVDB file for another process.
//
//   reader read PATH MEGABYTES SECONDS    says what grids there are, then sends the voxels of the one whose number comes in
//   reader write PATH                     writes a grid that comes in; for tests
//
// All numbers are as this machine has them. It ends by itself where it takes more memory or processor time than it may.
#include <openvdb/io/Stream.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Dense.h>

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <fstream>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

#include <algorithm>
#include <sys/resource.h>
#include <unistd.h>

namespace {

FILE* out = nullptr;

template<typename T> void put(const T& value)
{
  // Nobody is there to read it: then nothing is left to do.
  if (std::fwrite(&value, sizeof value, 1, out) != 1) _exit(1);
}

void put_text(const std::string& text)
{
  put(static_cast<uint32_t>(text.size()));
  if (!text.empty() && std::fwrite(text.data(), text.size(), 1, out) != 1) _exit(1);
}

template<typename T> T take()
{
  T value;
  if (std::fread(&value, sizeof value, 1, stdin) != 1) _exit(0);
  return value;
}

std::string take_text()
{
  std::string text(take<uint32_t>(), ' ');
  if (!text.empty() && std::fread(text.data(), text.size(), 1, stdin) != 1) _exit(0);
  return text;
}

/// Says why it failed, and ends.
[[noreturn]] void fail(const std::string& why)
{
  put<uint32_t>(1);
  put_text(why.substr(0, 1000));
  std::fflush(out);
  _exit(1);
}

void limit(int what, rlim_t most)
{
  // A limit that holds already and is lower cannot be raised.
  rlimit now{};
  if (getrlimit(what, &now) == 0) most = std::min(most, now.rlim_max);
  const rlimit both{most, most};
  if (setrlimit(what, &both) != 0) fail("its limits cannot be set");
}

uint32_t number_of(openvdb::GridClass grid_class)
{
  switch (grid_class) {
    case openvdb::GRID_FOG_VOLUME: return 1;
    case openvdb::GRID_LEVEL_SET: return 2;
    case openvdb::GRID_STAGGERED: return 3;
    case openvdb::GRID_UNKNOWN: break;
  }
  return 0;
}

openvdb::GridPtrVec grids_of(const char* path)
{
  std::ifstream stream;
  // A stream that throws at its end: OpenVDB reads on behind it, and a wrong count then takes hours.
  stream.exceptions(std::ios_base::badbit | std::ios_base::failbit);
  stream.open(path, std::ios_base::in | std::ios_base::binary);
  char head[12];
  stream.read(head, sizeof head);
  uint32_t version;
  std::memcpy(&version, head + 8, sizeof version);
  if (version > openvdb::OPENVDB_FILE_VERSION)
    throw std::runtime_error("its format is version " + std::to_string(version) + ", and this OpenVDB reads up to " +
                             std::to_string(openvdb::OPENVDB_FILE_VERSION) + ": write it with an older version");
  stream.seekg(0);
  openvdb::io::Stream read(stream, /*delayLoad=*/false);
  openvdb::GridPtrVec grids;
  for (const auto& grid : *read.getGrids())
    if (grid) grids.push_back(grid);
  return grids;
}

openvdb::FloatTree::ValueOnCIter tiles_of(const openvdb::FloatGrid& grid)
{
  auto tiles = grid.tree().cbeginValueOn();
  // Not into the leaves.
  tiles.setMaxDepth(decltype(tiles)::LEAF_DEPTH - 1);
  return tiles;
}

void send_descriptions(const openvdb::GridPtrVec& grids)
{
  put<uint32_t>(0);
  put(static_cast<uint32_t>(grids.size()));
  for (const auto& grid : grids) {
    put_text(grid->getName());
    put_text(grid->valueType());
    put(number_of(grid->getGridClass()));
    put<uint32_t>(grid->isType<openvdb::FloatGrid>());
    const bool is_linear = grid->transform().isLinear();
    put<uint32_t>(is_linear);
    // Rows are the images of the axes: OpenVDB's vectors stand left of their matrices.
    const auto matrix = is_linear ? grid->transform().baseMap()->getAffineMap()->getMat4() : openvdb::Mat4d::identity();
    for (int row = 0; row < 4; ++row)
      for (int column = 0; column < 3; ++column) put<double>(matrix(row, column));
    uint64_t leaves = 0, tile_leaves = 0;
    if (const auto floats = openvdb::gridPtrCast<openvdb::FloatGrid>(grid)) {
      leaves = floats->tree().leafCount();
      for (auto tile = tiles_of(*floats); tile; ++tile) {
        openvdb::CoordBBox box;
        tile.getBoundingBox(box);
        const uint64_t side = box.dim()[0] / 8;
        tile_leaves += side * side * side;
      }
    }
    put(leaves);
    put(tile_leaves);
    put<uint64_t>(grid->memUsage());
  }
  std::fflush(out);
}

void put_origin(const openvdb::Coord& origin)
{
  for (int axis = 0; axis < 3; ++axis) put<int32_t>(origin[axis]);
}

void send_voxels(const openvdb::GridBase::Ptr& chosen)
{
  const auto grid = openvdb::gridPtrCast<openvdb::FloatGrid>(chosen);
  if (!grid) throw std::runtime_error("the grid is not of floats");
  put<uint32_t>(0);
  put<float>(grid->background());
  for (auto tile = tiles_of(*grid); tile; ++tile) {
    openvdb::CoordBBox box;
    tile.getBoundingBox(box);
    put<uint32_t>(1);
    put_origin(box.min());
    put<int32_t>(box.dim()[0]);
    put<float>(*tile);
  }
  static_assert(openvdb::FloatTree::LeafNodeType::SIZE == 512, "leaves of 8^3 voxels");
  for (auto leaf = grid->tree().cbeginLeaf(); leaf; ++leaf) {
    put<uint32_t>(2);
    put_origin(leaf->origin());
    float values[512];
    for (openvdb::Index at = 0; at < 512; ++at) values[at] = leaf->isValueOn(at) ? leaf->getValue(at) : 0.0f;
    put(values);
  }
  put<uint32_t>(0);
  std::fflush(out);
}

void read(const char* path)
{
  const auto grids = grids_of(path);
  send_descriptions(grids);
  const auto number = take<uint32_t>();
  if (number >= grids.size()) throw std::runtime_error("no such grid");
  send_voxels(grids[number]);
}

void write(const char* path)
{
  const auto name = take_text();
  openvdb::Coord low, size;
  for (int axis = 0; axis < 3; ++axis) low[axis] = take<int32_t>();
  for (int axis = 0; axis < 3; ++axis) size[axis] = take<int32_t>();
  auto matrix = openvdb::Mat4d::identity();
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 3; ++column) matrix(row, column) = take<double>();
  const auto grid_class = take<uint32_t>();
  const auto is_half = take<uint32_t>();
  std::vector<float> values(static_cast<size_t>(size[0]) * size[1] * size[2]);
  if (std::fread(values.data(), sizeof(float), values.size(), stdin) != values.size()) throw std::runtime_error("too few values");
  auto grid = openvdb::FloatGrid::create(0.0f);
  const openvdb::CoordBBox box(low, low + size.offsetBy(-1));
  const openvdb::tools::Dense<const float, openvdb::tools::LayoutZYX> dense(box, values.data());
  openvdb::tools::copyFromDense(dense, *grid, 0.0f, /*serial=*/true);
  grid->setTransform(openvdb::math::Transform::createLinearTransform(matrix));
  grid->setName(name);
  grid->setSaveFloatAsHalf(is_half != 0);
  for (auto known : {openvdb::GRID_FOG_VOLUME, openvdb::GRID_LEVEL_SET, openvdb::GRID_STAGGERED})
    if (number_of(known) == grid_class) grid->setGridClass(known);
  openvdb::io::File(path).write(openvdb::GridPtrVec{grid});
  put<uint32_t>(0);
  std::fflush(out);
}

}  // namespace

int main(int argc, char** argv)
{
  // What the library prints is no answer.
  const int answers = dup(STDOUT_FILENO);
  if (answers < 0 || (out = fdopen(answers, "wb")) == nullptr || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) return 1;
  limit(RLIMIT_CORE, 0);
  try {
    if (argc == 5 && std::string(argv[1]) == "read") {
      limit(RLIMIT_AS, static_cast<rlim_t>(std::strtoull(argv[3], nullptr, 10)) << 20);
      limit(RLIMIT_CPU, static_cast<rlim_t>(std::strtoull(argv[4], nullptr, 10)));
      openvdb::initialize();
      read(argv[2]);
    } else if (argc == 3 && std::string(argv[1]) == "write") {
      openvdb::initialize();
      write(argv[2]);
    } else {
      fail("wrong arguments");
    }
  } catch (const std::bad_alloc&) {
    fail("it takes more memory than it may");
  } catch (const std::ios_base::failure&) {
    fail("it ends too early, or cannot be read");
  } catch (const std::exception& exception) {
    fail(exception.what());
  } catch (...) {
    fail("unknown exception");
  }
  // Without the destructors: there is nothing to be kept.
  _exit(0);
}
