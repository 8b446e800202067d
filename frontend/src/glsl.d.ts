// The text of a shader, which esbuild puts into the bundle.
declare module "*.glsl" {
  const text: string;
  export default text;
}
