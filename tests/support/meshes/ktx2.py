"""KTX2 textures written by basis_universal's own encoder."""

import base64
import zlib

import numpy as np

COLORS = np.array(
    [[[200, 40, 40], [40, 200, 40], [40, 40, 200]], [[220, 220, 220], [20, 20, 20], [220, 220, 40]]], np.uint8
)
PIXELS = np.repeat(np.repeat(COLORS, 4, 0), 4, 1)  # (8, 12, 3), with one colour for each block of a texture
ETC1S = zlib.decompress(
    base64.b64decode(
        "eNpb7R0SoWBksJuXS4qLAQgYgZgHiDkYEIARCWcAsQ4QTwFiFSDeAVUzE0oHMkJoZgZUoAOlmRg0GBYzMjEwMyPbYQ9n/QcCeSANdFZ5UWZJahGD"
        "U2JxZrFCaF5mWWpRcWKOgpGeoQEDAxvQBjOgOl4g1kOzC9luBYc7IHc7COwV6EwWPzAFIjpJ9gPDGUaQ/W2Jb7gvMyswNYDUusgbvJ8u9iaAmQXI"
        "W7Fq1aqg0NBQVoaDLhBdn+J9GWZAmA4ajIvYQOHUtMxNWV+AwQdqWwNDju9nAGJcMQ8="
    )
)
UASTC = zlib.decompress(
    base64.b64decode(
        "eNpb7R0SoWBksJuXS4qLAQgYgZgHiDkYEIARikEgA4h1gHgKlEYHB6B0AhoNU8vEoMGwjJGJgZmZgUEArqsezvoPBPJAGuis8qLMktQiBqfE4sxi"
        "hdC8zLLUouLEHAUjPUMDBgYWkC6gNnFJ1qf2J47B9YuzSj61N7iJxGf9aW+gxgzjT589+7d88TlGOL+p6dF+A4T+6bOln9rf2g3nAwAbVipT"
    )
)
