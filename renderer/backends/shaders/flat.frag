#version 330 core
// A point's colour is the interpolated vertex colour of the side that is seen times its texture's.
struct Material {
#ifdef HAS_BASE_COLOR_TEX
    sampler2D base_color_texture;
#endif
    vec4 base_color_factor;  // 1: RGB is linear, and encoded here as sRGB (IEC 61966-2-1); 0: it is display-referred
};
uniform Material material;

#ifdef TEXCOORD_0_LOC
in vec2 uv;
#endif
in vec4 color;
#ifdef NORMAL_LOC
in vec3 back;
#endif
out vec4 frag_color;

void main()
{
    vec4 product = color;
#ifdef NORMAL_LOC
    if (!gl_FrontFacing) product.rgb = back;
#endif
    if (material.base_color_factor.r > 0.5) {
        vec3 light = clamp(product.rgb, 0.0, 1.0);
        product.rgb = mix(1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, 12.92 * light, lessThanEqual(light, vec3(0.0031308)));
    }
#ifdef HAS_BASE_COLOR_TEX
    product *= texture(material.base_color_texture, uv);
#endif
    // The vertex alpha was scaled so that every part's cutoff is one half.
    if (product.a < 0.5) discard;
    frag_color = vec4(clamp(product.rgb, 0.0, 1.0), 1.0);
}
