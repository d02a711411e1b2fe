// Colours of vertices as they are, in no light, in the Built-in and the Universal Render Pipeline.
Shader "Trisplat/Vertex Colors"
{
    Properties { [Enum(Off, 0, Back, 2)] _Cull("Cull", Float) = 0 }
    SubShader
    {
        Tags { "RenderType" = "Opaque" "Queue" = "Geometry" }
        Pass
        {
            Cull [_Cull]
            HLSLPROGRAM
            #pragma vertex place
            #pragma fragment color
            #pragma multi_compile_instancing
            #include "UnityCG.cginc"

            struct Corner
            {
                float4 position : POSITION;
                float4 color : COLOR;
                UNITY_VERTEX_INPUT_INSTANCE_ID
            };
            struct Pixel
            {
                float4 position : SV_POSITION;
                float3 color : COLOR0;
                UNITY_VERTEX_OUTPUT_STEREO
            };

            Pixel place(Corner corner)
            {
                Pixel pixel;
                UNITY_SETUP_INSTANCE_ID(corner);
                UNITY_INITIALIZE_VERTEX_OUTPUT_STEREO(pixel);
                pixel.position = UnityObjectToClipPos(corner.position);
                pixel.color = corner.color.rgb;
                // They are sRGB codes, which Unity hands on as they are.
                #ifndef UNITY_COLORSPACE_GAMMA
                pixel.color.r = GammaToLinearSpaceExact(pixel.color.r);
                pixel.color.g = GammaToLinearSpaceExact(pixel.color.g);
                pixel.color.b = GammaToLinearSpaceExact(pixel.color.b);
                #endif
                return pixel;
            }

            float4 color(Pixel pixel) : SV_Target
            {
                return float4(pixel.color, 1);
            }
            ENDHLSL
        }
    }
}
