#include "tests/support/draco_maker.h"

#include <cstring>

#include "draco/compression/encode.h"
#include "draco/mesh/mesh.h"

static void add(draco::Mesh &mesh, draco::GeometryAttribute::Type kind, draco::DataType type, int components,
                const void *data, size_t points, size_t element_bytes)
{
    draco::GeometryAttribute attribute;
    attribute.Init(kind, nullptr, int8_t(components), type, false, int64_t(element_bytes), 0);
    int id = mesh.AddAttribute(attribute, true, uint32_t(points));
    for (uint32_t i = 0; i < points; i++)
        mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i),
                                              static_cast<const uint8_t *>(data) + i * element_bytes);
}

size_t draco_make(const float (*positions)[3], const uint8_t (*joints)[4], size_t points, const uint16_t *indices,
                  size_t triangles, int sequential, uint8_t *out, size_t most)
{
    draco::Mesh mesh;
    draco::Encoder encoder;
    draco::EncoderBuffer buffer;

    mesh.set_num_points(uint32_t(points));
    mesh.SetNumFaces(triangles);
    for (uint32_t f = 0; f < triangles; f++)
        mesh.SetFace(draco::FaceIndex(f), {draco::PointIndex(indices[3 * f]), draco::PointIndex(indices[3 * f + 1]),
                                           draco::PointIndex(indices[3 * f + 2])});
    add(mesh, draco::GeometryAttribute::POSITION, draco::DT_FLOAT32, 3, positions, points, sizeof *positions);
    if (joints)
        add(mesh, draco::GeometryAttribute::GENERIC, draco::DT_UINT8, 4, joints, points, sizeof *joints);
    encoder.SetEncodingMethod(sequential ? draco::MESH_SEQUENTIAL_ENCODING : draco::MESH_EDGEBREAKER_ENCODING);
    if (!encoder.EncodeMeshToBuffer(mesh, &buffer).ok() || buffer.size() > most)
        return 0;
    memcpy(out, buffer.data(), buffer.size());
    return buffer.size();
}
