// The size of every class of the front end, by TypeScript's parser, as JSON: see tests/js/test_classes.py.

import { fileURLToPath } from "node:url";
import * as ast from "typescript/unstable/ast";
import { API } from "typescript/unstable/sync";

const ROOT = fileURLToPath(new URL("..", import.meta.url));

function* nodesOf(node) {
  yield node;
  const children = [];
  node.forEachChild((child) => {
    children.push(child);
  });
  for (const child of children) yield* nodesOf(child);
}

/** The heirs of a class fill in its methods, some by those of a tool that the class does not know. */
const isHeir = (node) => node.heritageClauses?.some(({ token }) => token === ast.SyntaxKind.ExtendsKeyword) ?? false;

/** The function that a method calls with its own arguments and nothing else, such as this.messages.send; or null. */
function forwardedBy(method, text) {
  const [only, ...others] = method.body?.statements ?? [];
  const call =
    only && !others.length && (ast.isReturnStatement(only) || ast.isExpressionStatement(only)) && only.expression;
  if (!call || !ast.isCallExpression(call)) return null;
  const called = text.slice(call.expression.pos, call.expression.end).trim();
  const given = call.arguments.map((argument) => text.slice(argument.pos, argument.end).trim()).join();
  const taken = method.parameters.map(({ name }) => name.text).join();
  return given === taken && /^this\.[#\w]+\./.test(called) ? called : null;
}

function describe(node, text) {
  const isMethod = (m) =>
    ast.isMethodDeclaration(m) || ast.isGetAccessorDeclaration(m) || ast.isSetAccessorDeclaration(m);
  const methods = node.members.filter(isMethod),
    own = isHeir(node) ? [] : methods,
    start = node.members.find(ast.isConstructorDeclaration);
  const stored = (start?.parameters ?? []).filter(({ modifiers }) => modifiers?.length); // parameter properties
  const inner = [...nodesOf(node)];
  return {
    methods: new Set(methods.map(({ name }) => name.text)).size,
    attributes: node.members.filter(ast.isPropertyDeclaration).length + stored.length,
    given: (start?.parameters ?? []).map(({ type }) => type?.typeName?.text).filter(Boolean),
    makes: inner.filter(ast.isNewExpression).map(({ expression }) => expression.text),
    forwards: own.filter((m) => m.name.text !== "close" && forwardedBy(m, text)).map((m) => m.name.text),
  };
}

/** The numbers of parts that aliases name of a record of parts: type A = EditorParts<"one" | "two", "three">. */
function countedNames({ name, type }) {
  if (!type.typeName?.text?.endsWith("Parts")) return [];
  return [[name.text, [...nodesOf(type)].filter(ast.isStringLiteral).length]];
}

const api = new API({ cwd: ROOT }),
  snapshot = api.updateSnapshot({ openProject: `${ROOT}tsconfig.json` }),
  classes = {},
  interfaces = {};
for (const { program } of snapshot.getProjects()) {
  for (const path of program.getSourceFileNames()) {
    if (!path.startsWith(`${ROOT}src/`)) continue;
    const file = program.getSourceFile(path);
    for (const node of nodesOf(file)) {
      if (ast.isClassLikeDeclaration?.(node) ?? ast.isClassDeclaration(node)) {
        classes[`${path.slice(ROOT.length + 4)}:${node.name?.text}`] = describe(node, file.text);
      } else if (ast.isTypeAliasDeclaration(node)) Object.assign(interfaces, Object.fromEntries(countedNames(node)));
    }
  }
}
api.close();
console.log(JSON.stringify({ classes, interfaces }));
