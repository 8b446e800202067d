// Check that classes of the front end are small, hold parts, and give each of them the few things that it uses.

import { fileURLToPath } from "node:url";
import * as ast from "typescript/unstable/ast";
import { API } from "typescript/unstable/sync";

const ROOT = fileURLToPath(new URL(".", import.meta.url));

const MOST_METHODS = 30,
  MOST_ATTRIBUTES = 15,
  MOST_NAMES = 12; // that a part uses of the editor

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

/** Classes and counted interfaces of the front end, by their names. */
function frontEnd() {
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
  return { classes, interfaces };
}

/** Sentences about what is too large. */
function* faults({ classes, interfaces }) {
  const byName = new Map(Object.entries(classes).map(([name, found]) => [name.split(":")[1], found]));
  for (const [name, { methods, attributes, given, forwards }] of Object.entries(classes)) {
    if (methods > MOST_METHODS || attributes > MOST_ATTRIBUTES)
      yield `${name} has ${methods} methods and ${attributes} attributes, at most ${MOST_METHODS} and ` +
        `${MOST_ATTRIBUTES}: let it hold parts, each of which has the few things that it uses`;
    for (const method of forwards) yield `${name}.${method} only forwards: let the caller hold the part`;
    const own = name.split(":")[1];
    for (const owner of given.filter((type) => byName.get(type)?.makes.includes(own)))
      yield `${name} is given its owner ${owner}: give it an interface of what it uses`;
  }
  for (const [name, count] of Object.entries(interfaces)) {
    if (count > MOST_NAMES) yield `${name} names ${count} parts, at most ${MOST_NAMES}: divide it`;
  }
}

const found = frontEnd();
if (Object.keys(found.classes).length < 100) throw new Error("the classes of the front end were not found");
const sentences = [...faults(found)];
for (const sentence of sentences) console.error(`error: ${sentence}`);
process.exitCode = sentences.length ? 1 : 0;
